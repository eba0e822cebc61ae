"""What an identified effect does, as curves with their uncertainty: one response for each place.

All goes through ``Effect.apply`` and the simulator, on signals made up to show what the effect
does, so that an effect of a user's own is shown as those of the catalogue are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.maps import StaticMap
from ..effects.operator_signals import Command, Spring
from ..effects.parameter import CoreKind
from ..effects.record import Record
from ..human import LinearElement
from ..runs.roles import target_is_sum
from .cores import neutral_gains
from .simulator import Simulator

INSIDE = (2.5, 97.5)  # percentiles of the draws
N_WAVE = 800  # samples of a period
SLOWEST, FASTEST = 0.5, 32.0  # rad/s
SEEN = 0.01  # of the amplitude, which an effect must change to be seen
DECAYED = 0.02  # of the largest response
ENDLESS = 5.0  # s shown of a response that does not decay
SINE = 2.0  # rad/s, at which operators answer
BAND = (0.1, 30.0)  # rad/s
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
    """A plot before it is computed: abscissa, and a line (or some by name) for parameters."""

    kind: str
    x: np.ndarray
    lines: Callable[[dict[str, float], np.ndarray], Any]
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
        self.core = self.model.simulation_.spec.core
        table = self.model.parameters_["value"]
        self.theta = np.array([float(table[p.name]) for p in self.core.parameters])
        self.values = {p.name: getattr(self.effect, p.name) for p in self.effect.parameters}

    @property
    def core_names(self) -> list[str]:
        return [p.name for p in self.core.parameters]

    def unit(self, signal: str) -> str | None:
        """Unit of a channel, or of the output for "u"."""
        units: dict[str, str | None] = self.model.simulation_.units
        return units.get(self.model.simulation_.output if signal == "u" else signal)

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
        spread = self.model.simulation_.spread
        made.remembered.update({("sd", name): value for name, value in spread.items()})
        made.remembered["sd", "e"] = spread[self.error]
        return made

    def draws(self, n: int, seed: Any) -> list[tuple[dict[str, float], np.ndarray]]:
        """Parameters of the effect and of the core, drawn from their covariance."""
        own = [f"{self.name}__{key}" for key in self.values]
        names = [*own, *self.core_names]
        covariance = self.model.covariance_.reindex(index=names, columns=names)
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
            spread = self.model.simulation_.spread
            largest = LARGEST * float(spread["u" if signal == "u" else self.error])
        return (1.05 if signal == "e" else BEYOND) * largest or 1.0

    def simulator(self, record: Record) -> Simulator:
        """The core with the effect, whose parameters follow those of the core in theta."""
        free = self.effect.with_choices(**dict.fromkeys(self.values))
        return Simulator(self.core, Effects([(self.name, free)]), record)

    def whole(self, values: dict[str, float], theta: np.ndarray) -> np.ndarray:
        return np.r_[theta, list(values.values())]


def effect_curves(
    model: Any,
    name: str,
    X: Any = None,
    y: Any = None,
    *,
    effect: Effect | None = None,
    n_draws: int = 0,
    random_state: Any = 0,
) -> EffectCurves:
    """What an effect of a fitted model does, or another in its place, as curves.

    ``X`` and ``y`` are channels and output of runs, for amplitudes, times and densities; without
    them those of the fit count. Bands hold 95 % of the draws of the parameters.
    """
    shown = dict(model.effects_.steps)[name] if effect is None else effect
    bench = Bench(model, name, shown, *_runs(model, X, y))
    found = response_plot(bench)

    def named(values: dict[str, float], theta: np.ndarray) -> dict[str, np.ndarray]:
        lines = found.lines(values, theta)
        return lines if isinstance(lines, dict) else {"with the effect": lines}

    best = named(bench.values, bench.theta)
    drawn = [named(*draw) for draw in bench.draws(n_draws, random_state)]
    curves = {}
    for label, values in best.items():
        curves[label] = Curve(found.x, values)
        if drawn:
            low, high = np.percentile([lines[label] for lines in drawn], INSIDE, axis=0)
            curves[label] = Curve(found.x, values, low, high)
    return EffectCurves(
        found.kind, curves, found.xlabel, found.ylabel, found.without, found.measured, found.note
    )


def _runs(model: Any, X: Any, y: Any) -> tuple[Record, np.ndarray | None]:
    """Channels of runs as the model takes them, and their output; both empty where X is None."""
    simulation = model.simulation_
    if X is not None:
        record = model.make_record(X)
        output = np.asarray(model.predict(X) if y is None else y, dtype=float)
        return record, output[np.isfinite(output)]
    element = model.controlled_element_
    roles = dict(simulation.roles)
    if target_is_sum(roles.values()):
        roles["f_t"] = "f_t"
    empty = np.zeros((0, 0))
    nothing = Record(
        dt=model.dt_,
        t=empty,
        channels={},
        roles=roles,
        inputs=tuple(model.inputs_),
        known=empty.astype(bool),
        controlled_element=None if element is None else LinearElement.of(element),
    )
    return nothing, None


def answers(bench: Bench, channel: str, run: Callable[[Record], np.ndarray]) -> bool:
    """Whether what ``run`` makes of a record moves with this channel alone."""
    t, pulse = unit_pulse(bench.record.dt)
    moved, still = (run(bench.made_up(t, c)) for c in ({channel: pulse}, {}))
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
        given = find_command(bench, error)
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


def find_command(bench: Bench, error: np.ndarray) -> Command:
    """The command of the core for an error, without delay."""
    late = np.ascontiguousarray(error[:, None])
    values = dict(zip(bench.core_names, bench.theta.tolist(), strict=True))
    position, rate = bench.core.command(late, neutral_gains(), values, bench.record.dt)
    return Command(position, rate, late, 0.0)


def passed(
    bench: Bench, record: Record, error: np.ndarray, values: dict[str, float] | None = None
) -> np.ndarray:
    """What the effect makes of the command for an error."""
    given = bench.values if values is None else values
    return total_command(bench.effect.apply(find_command(bench, error), record, **given), record.dt)


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
    return np.linspace(0.0, bench.model.simulation_.duration, N_TIMES)


def channel_range(bench: Bench, channel: str) -> tuple[float, float]:
    """Values of a channel: of the runs given, or likely by the fit."""
    if bench.has_runs and channel in bench.record.channels:
        real = bench.record.channels[channel][bench.record.known]
        low, high = float(real.min()), float(real.max())
        if low < high:
            return low, high
    middle = float(getattr(bench.effect, "reference", None) or 0.0)
    away = LARGEST * float(bench.model.simulation_.spread.get(channel, 1.0))
    return middle - away, middle + away


def core_delay(bench: Bench, theta: np.ndarray) -> float:
    return float(bench.core.delay(dict(zip(bench.core_names, theta.tolist(), strict=True))))


def response_plot(bench: Bench) -> Response:
    """The plot that shows most of an effect, by its place and what it answers."""
    place = bench.effect.place
    if bench.effect.noise:
        return course(bench)

    def simulate(record: Record) -> np.ndarray:
        return bench.simulator(record).run(bench.whole(bench.values, bench.theta))

    def add(record: Record) -> np.ndarray:
        return np.asarray(bench.effect.apply(np.zeros_like(record.t), record, **bench.values))

    if place in ("input", "path", "command", "sum"):
        for channel in bench.record.roles:
            if channel != bench.error and answers(bench, channel, simulate):
                return path(bench, channel)
    if place == "sum" and answers(bench, bench.error, add):
        return path(bench, bench.error)
    if place == "path":
        return path(bench, bench.error) if is_odd(bench) else added_command(bench)
    if place in ("input", "output"):
        return signal_map(bench, "e" if place == "input" else "u")
    if place in ("gain", "delay"):
        return parameter_path(bench)
    if place == "command":
        if isinstance(bench.effect, StaticMap):
            return signal_map(bench, "command")
        if share_of_command(bench, bench.values) is not None:
            return share(bench)
        return linear_gain(bench) if is_linear(bench) else held_command(bench)
    return inside(bench) if place in ("inside", "spring") else course(bench)


def signal_map(bench: Bench, signal: str) -> Response:
    """What comes out for a slow wave: a line, or a loop where it depends on the past."""
    size = bench.amplitude("e" if signal == "e" else "u")
    omega = SLOWEST
    x = -size * np.cos(2 * np.pi * (np.arange(2 * N_WAVE) + 0.5) / N_WAVE)

    def out(values: dict[str, float]) -> np.ndarray:
        t = np.arange(x.size) * 2 * np.pi / omega / N_WAVE
        given = {bench.error: x} if signal == "e" else {}
        wave: Any = x[:, None]
        if signal == "command":
            wave = Command(wave, np.zeros_like(wave), wave, 0.0)
        y = bench.effect.apply(wave, bench.made_up(t, given), **values)
        return np.asarray(y.position if signal == "command" else y)[N_WAVE:, 0]

    late = x[N_WAVE:]
    while omega < FASTEST and np.abs(out(bench.values) - late).max() < SEEN * size:
        omega *= 2
    if omega > SLOWEST:  # well beyond the frequency at which it begins
        omega *= 2
    half = N_WAVE // 2
    up, down = out(bench.values)[:half], out(bench.values)[half:][::-1]
    loop = np.abs(up - down).max() > SEEN * size
    part = slice(None) if loop else slice(half)
    name = bench.error if signal == "e" else bench.model.simulation_.output
    unit = bench.unit(name if signal == "e" else "u")
    what = {"e": _answered(bench), "u": "output"}.get(signal, "command")
    met = {"e": bench.error, "u": "u"}.get(signal)  # the command is not measured
    simulation = bench.model.simulation_
    behind: tuple[str, ...] = ()
    if bench.name in simulation.effects.names:  # not one that is shown without a fit
        behind = simulation.effects.before(bench.name, simulation.spec.core.kind == CoreKind.ARX)
    seen = f"{what} {name}" if met else what
    if behind:  # nor is what others made of a signal
        seen, met = f"{seen} behind {' and '.join(behind)}", None
    return Response(
        "loop" if loop else "map",
        late[part],
        lambda values, theta: out(values)[part],
        with_unit(seen, unit),
        with_unit(f"{what} behind the effect", unit),
        without=Curve(late[:half], late[:half]),
        measured=None if met is None else bench.met(met),
        note=f"response to a sine of {omega:g} rad/s" if loop else "",
    )


def added_command(bench: Bench) -> Response:
    """What a path adds to the command for a slow wave of the error, where it is no linear path."""
    size = bench.amplitude("e")
    x = np.linspace(-size, size, N_WAVE)
    t = np.linspace(0.0, bench.model.simulation_.duration, N_WAVE)
    zero = np.zeros((N_WAVE, 1))
    record = bench.made_up(t, {bench.error: x})

    given = Command(zero, zero, x[:, None], 0.0)
    return Response(
        "map",
        x,
        lambda values, theta: total_command(bench.effect.apply(given, record, **values), record.dt),
        with_unit(f"{_answered(bench)} {bench.error}", bench.unit(bench.error)),
        with_unit("added to the command", bench.unit("u")),
        without=Curve(x, np.zeros(N_WAVE)),
        measured=bench.met(bench.error),
    )


def path(bench: Bench, channel: str) -> Response:
    """Response of the output to a pulse of unit area in a channel, by the path alone."""
    t, pulse = unit_pulse(bench.record.dt)
    simulator = bench.simulator(bench.made_up(t, {channel: pulse}))
    bare = Simulator(bench.core, Effects([]), simulator.record)

    def out(values: dict[str, float], theta: np.ndarray) -> np.ndarray:
        return (simulator.run(bench.whole(values, theta)) - bare.run(theta))[:, 0]

    response = np.abs(out(bench.values, bench.theta))
    going = np.flatnonzero(response > DECAYED * response.max())
    end = float(t[going[-1]]) if going.size else 1.0
    end = ENDLESS if end > 0.9 * t[-1] else max(1.0, 1.2 * end)
    begin = min(float(t[going[0]]) if going.size else 0.0, 0.0) - 0.2
    shown = (t >= begin) & (t <= end)
    of_output, of_channel = (bench.unit(s) or f"[{s}]" for s in ("u", channel))
    width = (np.count_nonzero(pulse) + 1) * bench.record.dt
    return Response(
        "path",
        t[shown],
        lambda values, theta: {f"{channel} to output": out(values, theta)[shown]},
        "time, s",
        f"impulse response, {of_output}/({of_channel} s)",
        without=Curve(t[shown], np.zeros(int(shown.sum()))),
        note=f"a pulse of {width:.2g} s and unit area in {channel}",
    )


def parameter_path(bench: Bench) -> Response:
    """Gains or delay over the channel that they follow, else over the time in the run."""
    t = run_times(bench)
    for channel in bench.record.roles:
        low, high = channel_range(bench, channel)
        level = [bench.made_up(t, {channel: np.full(t.size, v)}) for v in (low, high)]
        first, second = (_parameters(bench, record, bench.values, bench.theta) for record in level)
        if any(np.ptp(np.r_[first[key], second[key]]) > np.ptp(first[key]) for key in first):
            x = np.linspace(low, high, t.size)
            record = bench.made_up(t, {channel: x})
            label = with_unit(channel, bench.unit(channel))
            return _parameter_response(bench, record, x, label, bench.met(channel))
    return _parameter_response(bench, bench.made_up(t), t, "time in the run, s", None)


def _parameter_response(
    bench: Bench, record: Record, x: np.ndarray, xlabel: str, real: np.ndarray | None
) -> Response:
    if bench.effect.place == "delay":
        return Response(
            "delay",
            x,
            lambda values, theta: _parameters(bench, record, values, theta),
            xlabel,
            "delay, s" if bench.core.kind.is_operator else "delay beside nk, s",
            without=Curve(x, np.full(x.size, core_delay(bench, bench.theta))),
            measured=real,
        )
    best = _parameters(bench, record, bench.values, bench.theta)
    labels = _gain_labels(bench, best)

    def lines(values: dict[str, float], theta: np.ndarray) -> dict[str, np.ndarray]:
        found = _parameters(bench, record, values, theta)
        return {label: found[name] for name, label in labels.items()}

    return Response(
        "gains",
        x,
        lines,
        xlabel,
        "relative to the nominal value",
        without=Curve(x, np.ones(x.size)),
        measured=real,
    )


def _parameters(
    bench: Bench, record: Record, values: dict[str, float], theta: np.ndarray
) -> dict[str, np.ndarray]:
    """Factors on the parameters of the core, or the delay, over the record."""
    n = record.t.size
    if bench.effect.place == "delay":
        delay = bench.effect.apply(core_delay(bench, theta), record, **values)
        return {"delay": np.broadcast_to(np.ravel(delay), n).astype(float)}
    gains = bench.effect.apply(neutral_gains(), record, **values)
    return {
        name: np.broadcast_to(np.ravel(factor), n).astype(float)
        for name, factor in zip(gains._fields, gains, strict=True)
    }


def _gain_labels(bench: Bench, factors: dict[str, np.ndarray]) -> dict[str, str]:
    """What to call the factors that are not one, with the values that they change between."""
    named = {"error": "K_e", "rate": "K_edot", "omega": "omega_nm", "zeta": "zeta_nm"}
    known = bench.model.parameters_
    moved = [key for key, factor in factors.items() if not np.allclose(factor, 1.0)]
    if "K_e" not in known.index:  # an ARX model has one gain, whatever its parameters are
        return {"omega": "natural frequency"} if moved == ["omega"] else {"error": "gain"}
    groups: list[list[str]] = []
    for key in moved or ["error"]:
        same = [g for g in groups if np.array_equal(factors[g[0]], factors[key])]
        if same:
            same[0].append(key)
        else:
            groups.append([key])
    labels = {}
    for group in groups:
        factor = factors[group[0]]
        label = " and ".join(named[key] for key in group)
        ends = factor[0], factor[-1]
        row = known.loc[named[group[0]]]
        size, unit = (row["value"], row["unit"]) if len(group) == 1 else (1.0, "-")
        if not np.isclose(*ends):
            label += f": {size * ends[0]:.3g} to {size * ends[1]:.3g}"
            label += "" if unit == "-" else f" {unit}"
        labels[group[0]] = label
    return labels


def share(bench: Bench) -> Response:
    """Share of the command that is left, over the time in the run."""
    t = sampled_run(bench)
    one = np.ones(t.size)

    def lines(values: dict[str, float], theta: np.ndarray) -> np.ndarray:
        left = share_of_command(bench, values)
        return one if left is None else left

    return Response(
        "gains", t, lines, "time in the run, s", "share of the command", without=Curve(t, one)
    )


def linear_gain(bench: Bench) -> Response:
    """Gain of a filter of the command over frequency."""
    dt = bench.record.dt
    n = min(LONGEST, round(10 * AFTER / dt))
    t = np.arange(n) * dt
    pulse = np.zeros(n)
    pulse[10] = 1.0  # not the first sample, where derivatives are one-sided
    omega = 2 * np.pi * np.fft.rfftfreq(n, dt)
    inside = np.flatnonzero((omega >= BAND[0]) & (omega <= min(BAND[1], 1.5 / dt)))
    some = np.unique(np.geomspace(inside[0], inside[-1], 300).round().astype(int))
    record = bench.made_up(t)
    given = np.fft.rfft(total_command(find_command(bench, pulse), dt))[some]

    return Response(
        "gain",
        omega[some],
        lambda values, theta: np.abs(
            np.fft.rfft(passed(bench, record, pulse, values))[some] / given
        ),
        "frequency, rad/s",
        "gain on the command",
        without=Curve(omega[some], np.ones(some.size)),
    )


def held_command(bench: Bench) -> Response:
    """What becomes of a sine, where the command passes no linear filter."""
    dt = min(bench.record.dt, 2 * np.pi / SINE / 200)
    t = np.arange(0.0, 5 * np.pi / SINE, dt)
    x = bench.amplitude("e") * np.sin(SINE * t)
    record = bench.made_up(t)
    later = t >= 2 * np.pi / SINE
    shown = t[later] - t[later][0]
    return Response(
        "hold",
        shown,
        lambda values, theta: passed(bench, record, x, values)[later],
        "time, s",
        with_unit("command", bench.unit("u")),
        without=Curve(shown, total_command(find_command(bench, x), dt)[later]),
        note=f"for an error that is a sine of {SINE:g} rad/s",
    )


def _holding(bench: Bench, theta: np.ndarray) -> float:
    """Command that holds an output of one, by the linear core."""
    if bench.core.kind.is_operator:
        return 1.0
    a = np.array([n[0] == "a" for n in bench.core_names])
    b = np.array([n[0] == "b" for n in bench.core_names])
    return float((1.0 + theta[a].sum()) / theta[b].sum())


def inside(bench: Bench) -> Response:
    """Force or command over the output or its rate in the steady state, or its stops."""
    record = bench.made_up(np.arange(2.0))
    limb = getattr(bench.effect, "of", None) == "limb"
    of_rate = limb or getattr(bench.effect, "of", None) == "rate"
    is_operator = bench.core.kind.is_operator
    size = bench.amplitude("u")
    if of_rate:
        size = LARGEST * float(getattr(bench.effect, "reference", None) or size)
    x = np.linspace(-size, size, N_WAVE)
    best = bench.effect.apply(Spring(), record, **bench.values)
    has_stops = bool(np.isfinite(best.stops).any())

    def lines(values: dict[str, float], theta: np.ndarray) -> np.ndarray:
        added = bench.effect.apply(Spring(), record, **values)
        if has_stops:
            return np.clip(x, *added.stops)
        if of_rate:
            return added.force(np.zeros_like(x), x)
        return _holding(bench, theta) * x + added.force(x)

    name, unit = bench.model.simulation_.output, bench.unit("u")
    without = np.zeros(N_WAVE) if of_rate else x if has_stops else _holding(bench, bench.theta) * x
    if has_stops:
        what, of_what = f"output {name} between stops", unit
    elif bench.effect.place == "spring":
        what, of_what = "command that holds it", bench.unit("u" if is_operator else bench.error)
    elif limb:
        what, of_what = "force against the command", unit
    else:
        what = "force against the input" if of_rate else "input that holds it"
        of_what = bench.unit(bench.error)
    abscissa = f"rate of {name}" if of_rate else f"output {name}"
    return Response(
        "map" if has_stops else "spring",
        x,
        lines,
        with_unit(abscissa, unit and f"{unit}/s" if of_rate else unit),
        with_unit(what, of_what),
        without=Curve(x, without),
        measured=None if of_rate else bench.met("u"),
    )


def course(bench: Bench) -> Response:
    """What is added to the output over the time in the run; of noise a realisation."""
    zero, noise = np.zeros((N_TIMES, 1)), bool(bench.effect.noise)
    t = bench.effect.realisation(bench.values)[0] if noise else run_times(bench)
    record = bench.made_up(t)

    def lines(values: dict[str, float], theta: np.ndarray) -> np.ndarray:
        if noise:
            return bench.effect.realisation(values, t)[1]
        added = np.asarray(bench.effect.apply(zero, record, **values))
        return np.broadcast_to(added, (t.size, 1))[:, 0]

    return Response(
        "course",
        t,
        lines,
        "time, s" if noise else "time in the run, s",
        with_unit("added to the output", bench.unit("u")),
        without=Curve(t, np.zeros(t.size)),
        note="its phase is not known" if noise else "",
    )


def _answered(bench: Bench) -> str:
    """The name of what the core answers."""
    return "error" if bench.core.kind.is_operator else "input"


def with_unit(quantity: str, unit: str | None) -> str:
    return f"{quantity}, {unit}" if unit else quantity
