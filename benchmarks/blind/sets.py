"""Which answers are equal, written down before any verdict.

A strict figure counts the exact name only; the wanted figures of the issue allow these sets, since
such data cannot tell their members apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

NONE, UNKNOWN = "none", "unknown"

# Never open a gap of one point: a free delay, gains and neuromuscular filter absorb them.
ABSORBED = {"extra_lag", "nm_mode"}
SETS: tuple[frozenset[str], ...] = (
    frozenset({"stiction", "backlash"}),
    frozenset({"gain_drift", "tv_gain"}),
    frozenset({"integral", "output_feedback"}),
)
LINEAR = frozenset({"extra_lag", "nm_mode", "higher_order", "wrong_delay", NONE})

# With an effect left out of the catalogue, what is physically equal to it, or contains it.
FAMILIES: tuple[frozenset[str], ...] = (
    *SETS,
    frozenset({"feedforward", "preview"}),  # the same path, earlier or later
    frozenset({"wrong_delay", "tv_delay"}),  # a change of zero, or one before the run
    frozenset({"asym_gain", "rectified", "absolute_value"}),  # K (e + a abs(e))
    frozenset({"wrong_delay", "extra_lag", "extra_lead", "nm_mode", "higher_order"}),
    frozenset({"lapses", "tv_gain"}),  # gains that vanish for a while
    frozenset({"bias", "drift"}),  # an offset that settles holds one that stays
    frozenset({"dead_zone", "cubic_gain"}),  # odd maps of the error whose gain grows with it
    frozenset({"saturation", "hardening_stiffness"}),  # slowly, a stiffening spring limits softly
    # Behind the delay, a gain of the command that falls with its size: a limit is the hardest.
    frozenset({"saturation", "cubic_gain"}),
    # A rational function of the error: integrals have a pole, and an inner loop through the
    # controlled element is one with it.
    frozenset({"higher_order", "integral"}),
    frozenset({"higher_order", "output_feedback"}),
)

# Locked to time or to the target: what remnant does not dither and all runs share.
COHERENT = frozenset(
    {"tv_delay", "tv_gain", "gain_drift", "lapses", "bias", "drift", "integral"}
    | {"feedforward", "preview", "output_feedback", "disturbance", "wrong_delay"}
    | {"attention", "fatigue", "swinging_delay", "wandering_offset"}
)


def right_answers(name: str, gap: float) -> frozenset[str]:
    """The answers that count as right for an effect, by the sets."""
    if name in ABSORBED:
        return LINEAR
    right = {name}.union(*(group for group in SETS if name in group))
    if name in LINEAR and name != "wrong_delay":
        right |= LINEAR - {NONE, "wrong_delay"}
    if name == "extra_lead":
        right.add("higher_order")  # a rational function contains it
    if gap < 1 and name != "tremor":
        right.add(NONE)
    return frozenset(right)


def right_without(name: str) -> frozenset[str]:
    """The answers that count as right where the catalogue lacks an effect."""
    right = {UNKNOWN}.union(*(group for group in FAMILIES if name in group)) - {name}
    if name in ABSORBED:
        right.add(NONE)  # nothing is missing from the answer
    return frozenset(right)


@dataclass(frozen=True)
class Right:
    """A shape that is right for a hidden effect.

    Parameters
    ----------
    id : str
        Of the free form.
    places : frozenset of str
        Where it acts; several where the data cannot tell them apart.
    of : frozenset of str
        What a gain or delay is a function of, or the channel of a path; empty: not asked.
    """

    id: str
    places: frozenset[str]
    of: frozenset[str] = frozenset()


def _right(form: str, places: str, of: str = "") -> Right:
    return Right(form, frozenset(places.split()), frozenset(of.split()))


# Which shapes are right, written down before any was seen. What cannot be told apart:
# - A map behind the muscles' delay: below the limb's bandwidth (11 rad/s; the target's power lies
#   below 4) the output follows the command, and force and deflection of the spring are each other's
#   inverse. So command, spring and output are one place.
ON_ERROR = _right("free_map", "input")
BEHIND = _right("free_map", "command output spring")
# - Dry friction in a limb without mass is a play at its output, and a map of the rate (its sign)
#   as a force: plays, sticks and bristles are hysteresis, or a map of the rate.
MEMORY = _right("free_hysteresis", "command output spring inside")
DAMPING = _right("free_map", "rate")
# - A linear answer to the error is a path from e, or dynamics behind it. Its own output reaches the
#   operator through the controlled element alone, so an answer to x is one with an inner loop.
DYNAMICS = _right("free_dynamics", "inside command output")
FROM_ERROR = _right("free_path", "path", "e")
FROM_OUTPUT = _right("free_path", "path", "x")
# - f_t = e + x, and a linear answer to e is there already: an answer to f_t or to x.
FROM_TARGET = _right("free_path", "path", "f_t x")
GAIN_IN_TIME = _right("free_gain", "gain", "time")
DELAY_IN_TIME = _right("free_delay", "delay", "time")
OFFSET = _right("free_offset", "sum output", "time")
RIGHT_SHAPES: dict[str, tuple[Right, ...]] = {
    "wrong_delay": (_right("free_delay", "delay"), DYNAMICS, FROM_ERROR),
    "tv_delay": (DELAY_IN_TIME,),
    # Held until it has changed by a threshold: it sticks. A clock's holds are noise, no shape.
    "intermittent, event": (_right("free_hysteresis", "input command output spring inside"),),
    "intermittent, clock": (),
    "tv_gain": (GAIN_IN_TIME,),
    "gain_drift": (GAIN_IN_TIME,),
    "lapses": (GAIN_IN_TIME,),
    "scheduled_gain": (_right("free_gain", "gain", "speed"),),
    "dead_zone": (ON_ERROR,),
    "asym_gain": (ON_ERROR,),
    "rectified": (ON_ERROR,),
    "cubic_gain": (ON_ERROR,),
    "absolute_value": (ON_ERROR,),
    "saturation": (BEHIND,),
    "hardening_stiffness": (BEHIND,),
    "quantised": (BEHIND,),
    "rate_limit": (DAMPING,),
    "backlash": (MEMORY, DAMPING),
    "stiction": (MEMORY, DAMPING),
    "bias": (OFFSET,),
    "drift": (OFFSET,),
    "integral": (DYNAMICS, FROM_ERROR, FROM_OUTPUT),
    "tremor": (),  # its phase differs from run to run
    "feedforward": (FROM_TARGET,),
    "preview": (FROM_TARGET,),
    "output_feedback": (FROM_TARGET, DYNAMICS),
    # Of a body that is shaken: an answer at once, at the output itself.
    "motion_feedback": (_right("free_path", "path", "motion_acc"),),
    "motion_feedback, fed through": (_right("free_path", "path sum", "motion_acc"),),
    "motion_feedback, of x": (_right("free_path", "path", "motion_acc x"), DYNAMICS),
    "disturbance": (_right("free_path", "path", "dist"),),
    "cross_axis": (_right("free_path", "path", "e_y"),),
    "extra_lag": (DYNAMICS, FROM_ERROR),
    "extra_lead": (DYNAMICS, FROM_ERROR),
    "nm_mode": (DYNAMICS, FROM_ERROR),
    "higher_order": (DYNAMICS, FROM_ERROR, FROM_OUTPUT),
    # Of the suite beyond.
    "falling_gain": (ON_ERROR,),
    "dual_slope": (ON_ERROR,),
    "fechner": (ON_ERROR,),
    "plateau": (ON_ERROR,),
    "one_sided_detent": (BEHIND,),
    "one_sided_spring": (BEHIND,),
    "quadratic_damping": (DAMPING,),
    "one_sided_damping": (DAMPING,),
    "attention": (GAIN_IN_TIME,),
    "fatigue": (GAIN_IN_TIME,),
    "airspeed_gain": (_right("free_gain", "gain", "speed"),),
    "workload_delay": (_right("free_delay", "delay", "speed"),),
    "swinging_delay": (DELAY_IN_TIME,),
    "wandering_offset": (OFFSET,),
    "many_plays": (MEMORY,),
    "bristles": (MEMORY, DAMPING),
    "cross_two_lags": (_right("free_path", "path", "e_y"),),
    "squared_channel": (_right("free_path", "path", "speed"),),  # of which it shows a part
    "fractional_lag": (DYNAMICS, FROM_ERROR),
    "two_notches": (DYNAMICS, FROM_ERROR, FROM_OUTPUT),
}

# Of the suite beyond: names of the catalogue that describe nearly the same.
NEAR: dict[str, frozenset[str]] = {
    "falling_gain": frozenset({"cubic_gain"}),
    "dual_slope": frozenset({"cubic_gain", "dead_zone", "asym_gain"}),
    "fechner": frozenset({"cubic_gain", "dead_zone"}),
    "plateau": frozenset({"dead_zone", "asym_gain"}),
    "one_sided_detent": frozenset({"dead_zone"}),
    "one_sided_spring": frozenset({"hardening_stiffness", "saturation"}),
    "quadratic_damping": frozenset({"rate_limit"}),
    "attention": frozenset({"tv_gain"}),
    "fatigue": frozenset({"tv_gain", "gain_drift", "lapses"}),
    "airspeed_gain": frozenset({"scheduled_gain"}),
    "swinging_delay": frozenset({"tv_delay"}),
    "wandering_offset": frozenset({"drift", "bias"}),
    # Dry friction in the limb is what bristles describe, and what many plays add up to.
    "many_plays": frozenset({"backlash", "stiction", "friction"}),
    "bristles": frozenset({"backlash", "stiction", "friction"}),
    "cross_two_lags": frozenset({"cross_axis"}),
    "fractional_lag": frozenset({"higher_order", "extra_lag", "extra_lead", "nm_mode"}),
    "two_notches": frozenset({"higher_order"}),
}


def right_shapes(name: str, truth: dict[str, Any]) -> tuple[Right, ...]:
    """The shapes that count as right for an effect; none where no shape can show it.

    With rate control the operator leads so little (0.12 s, 20 degrees at 3 rad/s) that the command
    is the error: a map of the one is a map of the other.
    """
    parameters = truth["parameters"][name]
    if name == "intermittent":
        name += ", event" if "threshold" in parameters else ", clock"
    elif name == "motion_feedback" and truth["motion"] != "x and platform":
        name += ", of x" if truth["motion"] == "x" else ", fed through"
    right = RIGHT_SHAPES[name]
    if ON_ERROR in right and truth["plant"] == "rate":
        right = (*right, _right("free_map", "command"))
    return right
