"""A fitted model with one of its effects, on signals made up to show what the effect does.

All goes through ``Effect.apply`` and the simulator, so that an effect of a user's own is drawn as
those of the catalogue are: by the place where it acts, and by what it turns out to answer. Open it
to change the signals; what is drawn from them is in ``_effect_curves``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.operator_signals import Command
from ..effects.record import Record
from ..model.cores import neutral_gains
from ..model.estimator import labelled_covariance
from ..model.simulator import Simulator

LONGEST = 2**15  # samples
SPARE = 8  # draws for one, since some are out of bounds
N_TIMES = 2000  # instants in a run
PULSE = 0.1  # s, or four samples
BEFORE, AFTER = 2.0, 20.0  # s around a pulse
LARGEST = 3.3  # standard deviations
BEYOND = 1.4  # of the largest output, which may have met a limit


@dataclass
class Curve:
    """A line with its band; the limits are None where no uncertainty is known."""

    x: np.ndarray
    y: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None


@dataclass
class EffectCurves:
    """What an effect does.

    ``kind`` is map, loop, path, gains, delay, gain, hold, spring or course. ``without`` is what
    there would be without the effect, ``measured`` the values whose density belongs below.
    """

    kind: str
    curves: dict[str, Curve]
    xlabel: str
    ylabel: str
    without: Curve
    measured: np.ndarray | None = None
    note: str = ""


@dataclass
class Response:
    """A plot before it is computed: abscissa, and lines for values of the parameters."""

    kind: str
    x: np.ndarray
    lines: Callable[[dict[str, float], np.ndarray], dict[str, np.ndarray]]
    xlabel: str
    ylabel: str
    without: Curve
    measured: np.ndarray | None = None
    note: str = ""


@dataclass
class Bench:
    """A fitted model, one of its effects, and the signals that the effect is tried on.

    ``record`` holds the channels of runs, or none (``known`` is empty) where no runs are given.
    """

    model: Any
    name: str
    effect: Effect
    record: Record
    output: np.ndarray | None
    core: Any = field(init=False)
    theta: np.ndarray = field(init=False)
    values: dict[str, float] = field(init=False)

    def __post_init__(self) -> None:
        self.core = self.model._simulation.spec.core
        table = self.model.parameters_["value"]
        self.theta = np.array([float(table[p.name]) for p in self.core.parameters])
        self.values = {p.name: getattr(self.effect, p.name) for p in self.effect.parameters}

    @property
    def core_names(self) -> list[str]:
        return [p.name for p in self.core.parameters]

    def unit(self, signal: str) -> str | None:
        """Unit of a channel, or of the output for "u"."""
        units: dict[str, str | None] = self.model._units
        return units.get(self.model._output_name if signal == "u" else signal)

    @property
    def error(self) -> str:
        return str(self.record.inputs[0])

    @property
    def has_runs(self) -> bool:
        return bool(self.record.known.size)

    def met(self, signal: str) -> np.ndarray | None:
        """Values of a channel, or of the output for "u", in the runs; None where none are given."""
        if not self.has_runs:
            return None
        return self.output if signal == "u" else self.record.channels[signal][self.record.known]

    def made_up(self, t: np.ndarray, channels: Mapping[str, np.ndarray] | None = None) -> Record:
        """A record of one run whose channels are zero but for those given."""
        zero = np.zeros((t.size, 1))
        signals = dict.fromkeys(self.record.roles, zero)
        given = channels or {}
        signals.update({name: np.reshape(values, (-1, 1)) for name, values in given.items()})
        made = Record(
            dt=float(t[1] - t[0]),
            t=np.reshape(t, (-1, 1)),
            channels=signals,
            roles=self.record.roles,
            inputs=self.record.inputs,
            known=np.ones((t.size, 1), dtype=bool),
            controlled_element=self.record.controlled_element,
        )
        # Effects that refer to standard deviations mean those of the data of the fit.
        spread = self.model._simulation.spread
        made._derived.update({("sd", name): value for name, value in spread.items()})
        made._derived["sd", "e"] = spread[self.error]
        return made

    def draws(self, n: int, seed: Any) -> list[tuple[dict[str, float], np.ndarray]]:
        """Parameters of the effect and of the core, drawn from their covariance."""
        own = [f"{self.name}__{key}" for key in self.values]
        names = [*own, *self.core_names]
        covariance = labelled_covariance(self.model).reindex(index=names, columns=names)
        # What is fixed, or at a bound, has no covariance and stays.
        covariance = covariance.fillna(0.0).to_numpy()
        if n == 0 or not covariance.any():
            return []
        mean = np.r_[list(self.values.values()), self.theta]
        scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        unit = np.where(scale > 0, scale, 1.0)
        rng = np.random.default_rng(seed)
        drawn = rng.multivariate_normal(
            np.zeros(mean.size), covariance / np.outer(unit, unit), size=SPARE * n, method="eigh"
        )
        drawn = mean + drawn * unit
        k = len(own)
        limits = self.effect.limits(self.made_up(run_times(self)))
        low, high = np.array([limits[key] for key in self.values]).reshape(-1, 2).T
        low, high = np.minimum(low, mean[:k]), np.maximum(high, mean[:k])
        # Draws within the bounds that the estimate keeps to; not moved there, lest they pile up.
        inside = np.all((drawn[:, :k] >= low) & (drawn[:, :k] <= high), axis=1)
        rows = drawn[inside][:n]
        return [(dict(zip(self.values, row[:k].tolist(), strict=True)), row[k:]) for row in rows]

    def amplitude(self, signal: str) -> float:
        """The largest value that the plot of a map needs: of the runs, or likely by the fit."""
        real = self.met("u" if signal == "u" else self.error)
        if real is not None and real.size:
            largest = float(np.quantile(np.abs(real), 0.999))
        else:
            spread = self.model._simulation.spread
            largest = LARGEST * float(spread["u" if signal == "u" else self.error])
        return (1.05 if signal == "e" else BEYOND) * largest or 1.0

    def simulator(self, record: Record) -> Simulator:
        """The core with the effect, whose parameters follow those of the core in theta."""
        free = self.effect.with_choices(**dict.fromkeys(self.values))
        return Simulator(self.core, Effects([(self.name, free)]), record)

    def whole(self, values: dict[str, float], theta: np.ndarray) -> np.ndarray:
        return np.r_[theta, list(values.values())]


def answers(bench: Bench, channel: str) -> bool:
    """Whether the output moves when this channel does and the error stays."""
    t, pulse = unit_pulse(bench.record.dt)
    moved, still = (
        bench.simulator(record).run(bench.whole(bench.values, bench.theta))
        for record in (bench.made_up(t, {channel: pulse}), bench.made_up(t))
    )
    return bool(np.abs(moved - still).max() > 0.0)


def is_odd(bench: Bench) -> bool:
    """Whether a path answers the negative of an error by the negative."""
    t, pulse = unit_pulse(bench.record.dt)
    zero = np.zeros((t.size, 1))
    found = []
    for sign in (1.0, -1.0):
        record = bench.made_up(t, {bench.error: sign * pulse})
        command = Command(zero, zero, sign * pulse[:, None], 0.0)
        found.append(total_command(bench.effect.apply(command, record, **bench.values), record.dt))
    return bool(np.allclose(found[0], -found[1], atol=1e-9 * (np.abs(found[0]).max() or 1.0)))


def share_of_command(bench: Bench, values: dict[str, float]) -> np.ndarray | None:
    """Factor on the command over the run; None where it is constant, or no factor does it."""
    t = sampled_run(bench)
    record, slow = bench.made_up(t), 2 * np.pi / t[-1]
    made = []
    for error in (1.0 + 0.1 * np.sin(slow * t), 1.0 - 0.1 * np.cos(2 * slow * t)):
        # Of a position: what scales the rate as well kicks at every change of the factor.
        given = command_of(bench, error)
        given = given._replace(rate=np.zeros_like(given.rate))
        after = bench.effect.apply(given, record, **values)
        made += [total_command(after, record.dt), total_command(given, record.dt)]
    first, of_first, second, of_second = made
    size = np.abs(of_first).max() * np.abs(of_second).max()
    if not np.allclose(first * of_second, second * of_first, rtol=0.0, atol=1e-9 * size):
        return None
    share = first / of_first
    return share if np.ptp(share) > 1e-6 else None


def is_linear(bench: Bench) -> bool:
    """Whether the command passes a filter that is linear and the same at all times."""
    t = sampled_run(bench)
    k = np.arange(t.size)
    record = bench.made_up(t)
    # Beside a slow wave, since what is held does not show while the command stays.
    slow, shift = np.cos(1e-3 * k), 7
    wave = np.where(k > 100, np.sin(0.05 * k), 0.0)
    late = np.r_[np.zeros(shift), wave[:-shift]]
    size = bench.amplitude("e")
    still, once, twice, later = (
        passed(bench, record, size * (slow + x)) for x in (0.0, wave, 2.0 * wave, late)
    )
    once, twice, later = once - still, twice - still, later - still
    near = 1e-6 * (np.abs(once).max() or 1.0)
    # Without the last samples, where derivatives are one-sided.
    same = np.allclose(once[: -2 * shift], later[shift:-shift], atol=near)
    return bool(np.allclose(twice, 2 * once, atol=near) and same)


def command_of(bench: Bench, error: np.ndarray) -> Command:
    """The command of the core for an error, without delay."""
    late = np.ascontiguousarray(error[:, None])
    values = dict(zip(bench.core_names, bench.theta.tolist(), strict=True))
    position, rate = bench.core.command(late, neutral_gains(), values)
    return Command(position, rate, late, 0.0)


def passed(
    bench: Bench, record: Record, error: np.ndarray, values: dict[str, float] | None = None
) -> np.ndarray:
    """What the effect makes of the command for an error."""
    given = bench.values if values is None else values
    return total_command(bench.effect.apply(command_of(bench, error), record, **given), record.dt)


def total_command(command: Command, dt: float) -> np.ndarray:
    """Position and derivative of the rate of a command of one run."""
    rate = np.asarray(command.rate)
    whole = command.position + (np.gradient(rate, dt, axis=0) if rate.any() else 0.0)
    return np.asarray(whole)[:, 0]


def unit_pulse(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Times around zero, and a raised cosine of unit area that begins there."""
    half = max(2, round(PULSE / 2 / dt))
    before, after = max(round(BEFORE / dt), 50), max(round(AFTER / dt), 200)
    t = np.arange(-before, after) * dt
    pulse = np.zeros(t.size)
    pulse[before : before + 2 * half + 1] = 1 - np.cos(np.pi * np.arange(2 * half + 1) / half)
    return t, pulse / (pulse.sum() * dt)


def sampled_run(bench: Bench) -> np.ndarray:
    """Instants of a run at the sampling time of the model."""
    t = run_times(bench)
    return np.arange(t[0], t[-1], max(bench.record.dt, (t[-1] - t[0]) / LONGEST))


def run_times(bench: Bench) -> np.ndarray:
    """Instants of a run: of the runs given, or of those of the fit."""
    if bench.has_runs:
        return np.linspace(float(bench.record.t.min()), float(bench.record.t.max()), N_TIMES)
    return np.linspace(0.0, bench.model._simulation.duration, N_TIMES)


def channel_range(bench: Bench, channel: str) -> tuple[float, float]:
    """Values of a channel: of the runs given, or likely by the fit."""
    if bench.has_runs and channel in bench.record.channels:
        real = bench.record.channels[channel][bench.record.known]
        low, high = float(real.min()), float(real.max())
        if low < high:
            return low, high
    middle = float(getattr(bench.effect, "reference", None) or 0.0)
    away = LARGEST * float(bench.model._simulation.spread.get(channel, 1.0))
    return middle - away, middle + away


def core_delay(bench: Bench, theta: np.ndarray) -> float:
    return float(bench.core.delay(dict(zip(bench.core_names, theta.tolist(), strict=True))))
