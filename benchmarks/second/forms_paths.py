"""Hidden paths beside the error, and hidden linear dynamics: pursuit, preview, motion, leaks, lags
and modes.

Open it for the published forms: Wasicko's pursuit, van der El's preview of the far and the near
viewpoint, the inverse of the element, the precision model's lag-lead. Paths that hang on outside
signals are added to the command.
"""

import numpy as np
from scipy.signal import cont2discrete

from . import signals
from .forms import form
from .world import DT, Run, World

PURSUIT = ("pursuit", "preview")


def add(world: World, signal: dict[int, np.ndarray], share: float) -> None:
    """Add signals to the command of each run, scaled to ``share`` of its standard deviation."""
    sd = float(np.std(np.concatenate(list(signal.values()))))
    for i, r in enumerate(world.runs):
        r.before = r.before + share * world.scale["c"] / sd * signal[i]


def of_target(world: World, make) -> dict[int, np.ndarray]:
    """make(run) of every run."""
    return {i: make(r) for i, r in enumerate(world.runs)}


def late(world: World, rng: np.random.Generator) -> float:
    """The delay of another eye path: often that of the error, else 0.05 s around it."""
    return world.person.delay + (0.0 if rng.random() < 0.5 else rng.uniform(-0.05, 0.05))


@form("feedforward", "position", "target", displays=PURSUIT)
def forward(world: World, size: float, rng: np.random.Generator) -> None:
    """A part of u follows the target itself."""
    tau = late(world, rng)
    add(world, of_target(world, lambda r: signals.delayed(r.f, tau, DT)), 0.25 + 0.6 * size)


@form("feedforward", "rate", "target", displays=PURSUIT)
def forward_rate(world: World, size: float, rng: np.random.Generator) -> None:
    """A part of u follows the rate of the target."""
    tau = late(world, rng)
    smooth = rng.uniform(0.03, 0.2)
    made = of_target(
        world, lambda r: signals.delayed(signals.lag(signals.rate(r.f, DT), smooth, DT), tau, DT)
    )
    add(world, made, 0.25 + 0.6 * size)


def inverse(world: World, r: Run, smooth: float) -> np.ndarray:
    """The input that makes the element follow the target, one smoothing lag per derivative."""
    slope = signals.rate(signals.lag(r.f, smooth, DT), DT)
    if world.element.order == 1:
        return slope / world.element.gain
    slope = signals.lag(slope, smooth, DT)
    return (signals.rate(slope, DT) + world.element.pole * slope) / world.element.gain


@form("feedforward", "inverse", "target", displays=PURSUIT)
def forward_inverse(world: World, size: float, rng: np.random.Generator) -> None:
    """The inverse of the element on the target, after the person's delay (Wasicko, Drop)."""
    share, tau, smooth = 0.2 + 0.7 * min(size, 1.1), late(world, rng), rng.uniform(0.05, 0.25)
    for r in world.runs:
        r.before = r.before + share * signals.delayed(inverse(world, r, smooth), tau, DT)


@form("preview", "far", "target", displays=("preview",))
def far(world: World, size: float, rng: np.random.Generator) -> None:
    """Van der El's far viewpoint: the error is taken of the target ahead, low-passed."""
    ahead, smooth = rng.uniform(0.35, 0.9), rng.uniform(0.1, 0.5)
    share = min(1.0, 0.4 + 0.7 * size)
    for r in world.runs:
        r.seen = (1 - share) * r.f + share * signals.delayed(
            signals.lag(r.f, smooth, DT), -ahead, DT
        )


@form("preview", "near", "target", displays=("preview",))
def near(world: World, size: float, rng: np.random.Generator) -> None:
    """Van der El's near viewpoint: an open-loop answer to the target just ahead, high-passed."""
    ahead, smooth = rng.uniform(0.1, 0.35), rng.uniform(0.05, 0.3)
    ahead -= world.person.delay * rng.choice([0.0, 1.0])
    made = of_target(
        world, lambda r: signals.delayed(signals.rate(signals.lag(r.f, smooth, DT), DT), -ahead, DT)
    )
    add(world, made, 0.3 + 0.6 * size)


@form("preview", "inverse", "target", displays=("preview",))
def ahead_inverse(world: World, size: float, rng: np.random.Generator) -> None:
    """The inverse of the element on the target ahead of limb and filter."""
    share, smooth = 0.3 + 0.65 * min(size, 1.0), rng.uniform(0.05, 0.2)
    ahead = (
        smooth * world.element.order
        + 2 * world.person.zeta / world.person.omega
        + rng.uniform(-0.05, 0.15)
    )
    for r in world.runs:
        r.before = r.before + share * signals.delayed(inverse(world, r, smooth), -ahead, DT)


@form("output_feedback", "position", "output", displays=PURSUIT)
def feedback(world: World, size: float, rng: np.random.Generator) -> None:
    """A part of u answers the element's output with the person's delay."""
    gain = world.person.gain * (0.15 + 0.5 * size) * rng.choice([1.0, -0.6])
    world.put(x_gain=gain, x_delay=late(world, rng))


@form("output_feedback", "rate", "output", displays=PURSUIT)
def feedback_rate(world: World, size: float, rng: np.random.Generator) -> None:
    """Wasicko's inner loop: a part of u answers the rate of the element's output."""
    world.put(
        v_gain=(0.15 + 0.6 * size) * world.scale["c"] / world.scale["v"], x_delay=late(world, rng)
    )


@form("motion_feedback", "rate", "vestibule", orders=(2,))
def motion(world: World, size: float, rng: np.random.Generator) -> None:
    """The rate of the moving cab is felt, sooner than it is seen."""
    world.motion = "motion_rate"
    delay = world.person.delay * rng.uniform(0.5, 1.0)
    gain = (0.15 + 0.6 * size) * world.scale["c"] / world.scale["v"]
    world.put(motion=1, motion_gain=gain, motion_delay=delay)


@form("motion_feedback", "acceleration", "vestibule", orders=(2,))
def motion_acceleration(world: World, size: float, rng: np.random.Generator) -> None:
    """The acceleration of the moving cab is felt (otoliths)."""
    world.motion = "motion_acceleration"
    delay = world.person.delay * rng.uniform(0.5, 1.0)
    gain = (0.15 + 0.5 * size) * world.scale["c"] / (world.element.gain * world.scale["u"])
    world.put(motion=2, motion_gain=gain, motion_delay=delay)


@form("disturbance", "direct", "disturbance", dist=True)
def seen_disturbance(world: World, size: float, rng: np.random.Generator) -> None:
    """The disturbance is felt and countered before the error shows it; or it moves the hand."""
    tau, sign = rng.uniform(0.03, 0.3), rng.choice([-1.0, -1.0, 1.0])
    add(world, of_target(world, lambda r: sign * signals.delayed(r.d, tau, DT)), 0.2 + 0.5 * size)


@form("cross_axis", "leak", "channel")
def other_axis(world: World, size: float, rng: np.random.Generator) -> None:
    """The error of another axis, recorded, leaks into the hand after a delay."""
    forcing, tau = signals.Forcing(rng, fast=True), world.person.delay * rng.uniform(0.9, 1.1)
    for r in world.runs:
        r.channels["e_other"] = world.scale["e"] * forcing.run(len(r.f), DT, rng)
    add(
        world,
        of_target(world, lambda r: signals.delayed(r.channels["e_other"], tau, DT)),
        0.2 + 0.5 * size,
    )


def _filter(world: World, num: list[float], den: list[float]) -> None:
    b, a, _ = cont2discrete((num, den), DT, "bilinear")
    world.shape = np.concatenate([np.pad(b.ravel(), (0, 3 - b.size)), np.pad(a, (0, 3 - len(a)))])
    world.put(has_filter=1)


@form("extra_lag", "lag", "command", not_on=("K/s^2",))
def slow(world: World, size: float, rng: np.random.Generator) -> None:
    """A lag in the command, of a cautious person: the gain is not made up for, so that the loop
    stays stable.
    """
    _filter(world, [1.0], [0.15 + 0.7 * size, 1.0])


@form("extra_lag", "lag_lead", "command", orders=(1,))
def precision(world: World, size: float, rng: np.random.Generator) -> None:
    """Lag-lead of the precision model: the lag lifts the low frequencies, the person's lead ends
    it at crossover.
    """
    lead = rng.uniform(1.3, 2.5) / world.person.crossover
    lag = lead * (1.4 + 3.5 * size)
    w = 1j * world.person.crossover
    gain = abs((1 + lag * w) / (1 + lead * w)) * 0.9
    world.put(lead=0.0)
    _filter(world, [gain * lead, gain], [lag, 1.0])


@form("extra_lead", "lead", "command")
def quick(world: World, size: float, rng: np.random.Generator) -> None:
    """A second lead; the gain at crossover is kept."""
    lead = 0.1 + 0.5 * size
    world.put(
        second_lead=lead, gain=world.person.gain / abs(1 + 1j * world.person.crossover * lead)
    )


@form("integral", "trim", "command")
def trim(world: World, size: float, rng: np.random.Generator) -> None:
    """The low-frequency trim of the crossover model: a part proportional to the integral of the
    error.
    """
    world.put(integral=world.person.gain * world.person.crossover * (0.06 + 0.5 * size))


@form("nm_mode", "in_line", "limb")
def second_mode(world: World, size: float, rng: np.random.Generator) -> None:
    """A second mode of the limb in series."""
    w, z = world.person.omega * rng.uniform(0.7, 1.8), rng.uniform(0.06, 0.3) / (0.5 + size)
    _filter(world, [w**2], [1.0, 2 * z * w, w**2])


@form("nm_mode", "notch", "limb")
def mode_pair(world: World, size: float, rng: np.random.Generator) -> None:
    """A pair of antiresonance and resonance, as of a hand on a soft grip."""
    w = world.person.omega * rng.uniform(0.4, 1.0)
    ratio, z = 1 + 0.4 * size, 0.1
    _filter(world, [ratio**2, 2 * z * w * ratio, w**2], [1.0, 2 * z * w, w**2])


@form("higher_order", "lead_lag", "command")
def lead_lag(world: World, size: float, rng: np.random.Generator) -> None:
    """A lead-lag with a second pole: what no single lag or lead says."""
    a, b = rng.uniform(0.2, 0.5), rng.uniform(0.6, 1.0)
    low = (0.5 + 1.5 * size) * b
    _filter(world, [a * b * 0.5, a + b * 0.5, 1.0], [low * 0.1, low + 0.1, 1.0])


@form("higher_order", "quadratic", "command")
def quadratic(world: World, size: float, rng: np.random.Generator) -> None:
    """A damped pair of zeros over a damped pair of poles at other frequencies."""
    zero, pole = rng.uniform(1.5, 3.0), rng.uniform(3.5, 6.0)
    damping = 0.9 - 0.5 * min(size, 1.0)
    _filter(world, [1 / zero**2, 2 * damping / zero, 1.0], [1 / pole**2, 1.4 / pole, 1.0])
