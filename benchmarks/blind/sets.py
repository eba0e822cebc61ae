"""Which answers are equal, written down before any verdict.

A strict figure counts the exact name only; the wanted figures of the issue allow these sets, since
such data cannot tell their members apart.
"""

from __future__ import annotations

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
    # A rational function of the error: integrals have a pole, and an inner loop through the
    # controlled element is one with it.
    frozenset({"higher_order", "integral"}),
    frozenset({"higher_order", "output_feedback"}),
)

# Locked to time or to the target: what remnant does not dither and all runs share.
COHERENT = frozenset(
    {"tv_delay", "tv_gain", "gain_drift", "lapses", "bias", "drift", "integral"}
    | {"feedforward", "preview", "output_feedback", "disturbance", "wrong_delay"}
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
