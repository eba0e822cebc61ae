"""Effects whose curves lie nearest to that of a free form, and what separates them.

Both are compared as the model sees them, which refits a gain or a level beside a curve. An effect
``e' = e + delta(e)`` with a gain K is the same as ``e' = e + curve(e)`` with a gain K / factor if
``e + curve(e) = factor (e + delta(e))``; so is one of the gains, with 1 in place of e.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from ..effects.base import Effect
from ..effects.catalogue import CLASSES, EXPERIMENTS
from ..effects.free_form import LEVEL, SLOPE, TAIL, FreeForm
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import CoreKind
from ..effects.record import Record, differentiated
from ..effects.registry import title_of

COLUMNS = ("title", "form", "distance", "within_band", "parameters")
PLACES = {
    "spring": ("spring", "inside"),
    "gain": ("gain", "command"),
    "path": ("path", "command"),
}
LEAST_SHARE = 0.1  # of the band's half-width, below which no recording of use shows a difference
N_TIMES = 401
APART = 0.25  # of the greatest difference, from which two curves differ
N_POINTS = 60
MOST_STEPS = 25
NOTHING = 1e-6  # of the curve's size, by which an effect that has none may differ
BEYOND = 1e6  # in place of numbers that are not finite
SAME = 1e-9  # of the curve's size
Departure = Callable[[np.ndarray], np.ndarray]  # over any points, of what passes through
ANY_EXPERIMENT = (
    "record more runs, some at half and some at twice the amplitude and with other phases of the "
    "forcing function"
)


@dataclass(frozen=True)
class Near:
    """An effect of the catalogue with the numbers at which its curve is nearest to a shape's."""

    name: str
    form: str
    distance: float
    within_band: bool
    parameters: str
    curve: np.ndarray


def nearest_effects(
    form: FreeForm,
    curve: pd.DataFrame,
    record: Record,
    units: Mapping[str, str | None],
    gains: tuple[float, float] = (1.0, 0.0),
) -> list[Near]:
    """Effects that act where a free form does, nearest first, each fitted to its curve."""
    grid = curve.index.to_numpy(dtype=float)
    like = Likeness.of(form, grid, curve["value"].to_numpy(), record, gains)
    half = ((curve["high"] - curve["low"]) / 2).to_numpy()
    found: dict[str, Near] = {}
    for effect in candidates(form, record):
        near = _fitted(effect, like, record, half, units, gains)
        if near is not None and not near.distance >= found.get(effect.name, _FAR).distance:
            found[effect.name] = near
    return sorted(found.values(), key=lambda near: near.distance)


_FAR = Near("", "", np.inf, False, "", np.empty(0))


def candidates(form: FreeForm, record: Record) -> Iterator[Effect]:
    """Variants of the effects of the catalogue that act where a free form does."""
    places = PLACES.get(form.place, (form.place,))
    for kind in CLASSES:
        effect = kind()
        if effect.noise or effect.refusal_in(record, record.core):
            continue
        for one in effect.alternatives(record):
            variants: list[Any] = one.variants(record)
            yield from (
                _timed(form, v)
                for v in variants
                if v.place in places and _alike(form, v) and _follows(form, v)
            )


def acts_where(
    form: FreeForm,
    effect: Effect,
    values: dict[str, float],
    record: Record,
    gains: tuple[float, float],
) -> bool:
    """Whether an effect with its numbers acts where a free form does, on what the form follows."""
    places = PLACES.get(form.place, (form.place,))
    if effect.place not in places or not (_alike(form, effect) and _follows(form, effect)):
        return False
    grid = np.linspace(*form.ends, N_POINTS)
    made = find_departure(form, effect, effect.fixed | values, record, gains)(grid)
    return bool(np.abs(made).max() > NOTHING)


def _alike(form: FreeForm, effect: Effect) -> bool:
    """Whether an effect of the place can have a curve over the same."""
    if form.place == "gain":
        return effect.place == "gain" or effect.name == "lapses"
    if form.place == "path" and effect.place == "command":
        return form.name == "free_dynamics" and hasattr(effect, "form") is False
    return True


def _follows(form: FreeForm, effect: Any) -> bool:
    """Whether a variant is over the same channel, or over time, and has memory or not."""
    channel = getattr(form, "channel", None)
    own = getattr(effect, "channel", None)
    if form.name in ("free_map", "free_hysteresis") and form.place != "spring":
        return remembers(effect) == (form.name == "free_hysteresis")
    if form.place == "path":
        return True
    return own == channel


def _timed(form: Any, effect: Any) -> Effect:
    """A variant; lapses are where the gains of a shape are less than half of the usual."""
    if effect.name != "lapses":
        return effect
    t = np.linspace(form.knots[0], form.knots[-1], N_TIMES)
    gains = form.at_rest + form.curve(np.asarray(form.values), t)
    away = np.r_[False, gains < np.median(gains) / 2, False].astype(int)
    ends = zip(np.flatnonzero(np.diff(away) == 1), np.flatnonzero(np.diff(away) == -1), strict=True)
    stretches = [(float(t[a]), float(t[np.minimum(b, N_TIMES - 1)])) for a, b in ends]
    return effect.with_choices(intervals=stretches)


def remembers(effect: Effect) -> bool:
    """Whether what an effect makes of a sample depends on the samples before it."""
    return not hasattr(effect, "mapped") and effect.name not in ("rectified", "sensor_magnitude")


def _fitted(
    effect: Effect,
    like: Likeness,
    record: Record,
    half: np.ndarray,
    units: Mapping[str, str | None],
    gains: tuple[float, float],
) -> Near | None:
    names = [p.name for p in effect.free]
    limits = effect.limits(record)
    low, high = (np.array([limits[name][end] for name in names]) for end in (0, 1))
    begun = effect.starts(record)
    starts = np.array([[start[name] for name in names] for start in begun], dtype=float)
    starts = starts.reshape(len(begun), len(names))
    fixed = effect.fixed

    def departure(values: np.ndarray) -> np.ndarray:
        own = fixed | dict(zip(names, values.tolist(), strict=True))
        with np.errstate(all="ignore"):
            return find_departure(like.form, effect, own, record, gains)(like.at)

    fit = like.fitted(departure, starts, low, high)
    if fit is None:
        return None
    texts = []
    for parameter, value, acts in zip(effect.free, fit.values, fit.acts, strict=True):
        if acts:
            unit = parameter.find_dimension(record, effect.place).label(units)
            texts.append(f"{parameter.name} = {value:.4g}{'' if unit == '-' else f' {unit}'}")
    within = bool((np.abs(fit.curve - like.value) <= half).all())
    form = str(getattr(effect, "form", None) or "")
    shown = fit.curve + like.form.at_rest
    return Near(effect.name, form, fit.distance, within, ", ".join(texts), shown)


def nearest_table(found: Sequence[Near]) -> pd.DataFrame:
    """The nearest effects as a table, by id."""
    rows: list[Any] = [
        (title_of(n.name), n.form, n.distance, n.within_band, n.parameters) for n in found
    ]
    index = pd.Index([near.name for near in found], name="effect", dtype=object)
    return pd.DataFrame(rows, columns=list(COLUMNS), index=index)


def experiment_between(one: str, other: str) -> str:
    """What to record to tell two effects apart."""
    proposal = EXPERIMENTS.get(frozenset({one, other}), ANY_EXPERIMENT)
    return (
        f"{title_of(one)} and {title_of(other)} cannot be told apart here. To tell them apart, "
        f"{proposal}."
    )


def recordings_for(
    form: FreeForm, curve: pd.DataFrame, found: Sequence[Near], unit: str
) -> list[str]:
    """What to record to tell the shape from the nearest effect, and both nearest apart."""
    if not found:
        return []
    grid, value = curve.index.to_numpy(dtype=float), curve["value"].to_numpy()
    half = ((curve["high"] - curve["low"]) / 2).to_numpy()
    first = found[0]
    lines = []
    if form.over != "lag":
        apart = np.abs(value - first.curve)
        title = title_of(first.name)
        if first.within_band and (apart > LEAST_SHARE * half).any():
            lines.append(
                f"To tell the shape from {title}, {_where(form, grid, apart, half, unit)}."
            )
    if len(found) > 1 and found[1].within_band:
        one, other = title_of(first.name), title_of(found[1].name)
        known = EXPERIMENTS.get(frozenset({first.name, found[1].name}))
        if known is None and form.over != "lag":
            known = _where(form, grid, np.abs(first.curve - found[1].curve), half, unit)
        lines.append(f"To tell {one} from {other}, {known or ANY_EXPERIMENT}.")
    return lines


def _where(form: FreeForm, grid: np.ndarray, apart: np.ndarray, half: np.ndarray, unit: str) -> str:
    """Where curves differ most, relative to the band, and what to record there."""
    there = apart > APART * apart.max()
    at = float(grid[np.argmax(np.where(there, apart / np.maximum(half, 1e-300), 0.0))])
    label = "" if unit == "-" or "[" in unit else f" {unit}"
    share = float(np.max(apart / np.maximum(half, 1e-300)))
    more = max(int(np.ceil(1 / max(share, LEAST_SHARE) ** 2)), 2)
    what = {
        "e": "errors",
        "u": "outputs",
        "du/dt": "rates of the output",
        "command": "commands",
        "time": "runs",
    }.get(form.over, f"values of {form.over}")
    times = f"some {more} times as much data" if share > LEAST_SHARE else "many times as much data"
    if form.over == "time":
        return f"record {times} of the same task: they differ most at {at:.3g}{label}"
    return f"record {times} with {what} near {at:.3g}{label}, where the two differ most"


class Fit(NamedTuple):
    """The curve of an effect, or of a formula, that lies nearest to that of a free form."""

    values: np.ndarray
    acts: np.ndarray
    distance: float
    curve: np.ndarray


@dataclass(frozen=True)
class Likeness:
    """A free form's curve, ready to be compared with others."""

    form: FreeForm
    grid: np.ndarray
    value: np.ndarray
    points: np.ndarray
    there: np.ndarray
    operator: bool

    @classmethod
    def of(
        cls,
        form: FreeForm,
        grid: np.ndarray,
        value: np.ndarray,
        record: Record,
        gains: tuple[float, float] = (1.0, 0.0),
    ) -> Likeness:
        """Make it from a shape's curve, the record that it was found in, and the model's gains."""
        low, high = grid[0], grid[-1]
        points = np.linspace(low, high, N_POINTS)
        if form.over not in ("lag", "time"):
            levels = np.linspace(TAIL, 1 - TAIL, N_POINTS)
            points = np.clip(np.quantile(form.watched(record), levels), low, high)
        value = value - form.at_rest
        if form.over == "lag":
            of_pulse = form.with_choices(reference=0.0) if hasattr(form, "reference") else form
            answer = find_departure(form, of_pulse, {}, record, gains)
            value, there = answer(grid), answer(points)
        else:
            there = form.curve(np.asarray(form.values), points)
        return cls(form, grid, value, points, there, record.core != CoreKind.ARX)

    @property
    def removed(self) -> tuple[int, ...]:
        """Degrees of the polynomials that the model has already."""
        return tuple(degree for degree in (LEVEL, SLOPE) if degree not in self.form.kept)

    @property
    def divides(self) -> int | None:
        """The degree of these by which the model's own part is refitted as a factor."""
        if SLOPE in self.removed and (self.form.place != "spring" or self.operator):
            return None if self.form.over == "du/dt" else SLOPE
        return LEVEL if self.form.place == "gain" else None

    @property
    def at(self) -> np.ndarray:
        """Where a departure is needed: at the points and over the grid."""
        return np.concatenate([self.points, self.grid])

    def refitted_columns(self, at: np.ndarray) -> np.ndarray:
        """What the model refits beside the curve, as columns."""
        if self.form.name == "free_dynamics":  # the gains on error and error rate
            pulse = make_pulse(self.form, at)
            return np.stack([pulse, np.gradient(pulse, at)], axis=1)
        return np.polynomial.polynomial.polyvander(at, 1)[:, list(self.removed)]

    def refitted(self, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """At the points and over the grid, a departure with what the model refits beside it."""
        n, at = self.points.size, self.at
        common = self.refitted_columns(at)
        if self.divides is None:
            factor = np.linalg.lstsq(common[:n], self.there - delta[:n], rcond=None)[0]
            found = delta + common @ factor
            return found[:n], found[n:]
        unit = at**self.divides
        others = [k for k, degree in enumerate(self.removed) if degree != self.divides]
        columns = np.column_stack([unit + delta, common[:, others]])
        factors = np.linalg.lstsq(columns[:n], unit[:n] + self.there, rcond=None)[0]
        if not factors[0] > 0.0:  # no response is turned round
            return np.zeros(n), np.zeros(at.size - n)
        found = columns @ factors - unit
        return found[:n], found[n:]

    def fitted(
        self,
        departure: Callable[[np.ndarray], np.ndarray],
        starts: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
    ) -> Fit | None:
        """The nearest curve of a family of departures ``at`` all places, or None."""
        basis = np.linalg.qr(self.refitted_columns(self.points))[0]
        target = self.there - basis @ (basis.T @ self.there)
        size = float(np.sqrt(np.mean(target**2))) or 1.0

        def left(values: np.ndarray) -> np.ndarray:
            added = np.nan_to_num(departure(values), nan=BEYOND, posinf=BEYOND, neginf=-BEYOND)
            return (self.there - self.refitted(added)[0]) / size

        starts = np.clip(np.concatenate([starts, moved_off_zero(starts, low, high)]), low, high)
        errors = np.array([left(start) for start in starts])
        if np.abs(errors - target / size).max() < NOTHING:
            return None
        best = starts[np.argmin((errors**2).sum(axis=1))]
        acts = np.zeros(best.size, dtype=bool)
        if best.size:
            gap = 1e-9 * (np.minimum(high, 1e6) - np.maximum(low, -1e6))
            found = least_squares(
                left,
                np.clip(best, low + gap, high - gap),
                bounds=(low, high),
                x_scale=np.maximum(np.abs(best), 1e-3 * np.minimum(high - low, 1e6)),
                max_nfev=MOST_STEPS,
            )
            best, acts = found.x, np.abs(found.jac).max(axis=0) > SAME
        distance = float(np.sqrt(np.mean(left(best) ** 2)))
        return Fit(best, acts, distance, self.refitted(departure(best))[1])


def moved_off_zero(starts: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Starts off zero, where no curve could lead elsewhere: half of what is possible."""
    up, down = np.minimum(high / 2, 0.5), np.maximum(low / 2, -0.5)
    return np.concatenate([np.where(starts == 0.0, size, starts) for size in (up, down)])


def bare(record: Record, t: np.ndarray, **channels: np.ndarray) -> Record:
    """A record of one run in which nothing happens, with other times and some channels."""
    count = (t.size, 1)
    quiet = dict.fromkeys(record.channels, np.zeros(count))
    sizes = {("sd", name): record.sd(name) for name in ("u", record.inputs[0])}
    return Record(
        dt=record.dt,
        t=t[:, None],
        channels=quiet | {name: values.reshape(count) for name, values in channels.items()},
        roles=record.roles,
        inputs=record.inputs,
        known=np.ones(count, dtype=bool),
        controlled_element=record.controlled_element,
        core=record.core,
        time_unit=record.time_unit,
        least_delay=record.least_delay,
        domain=record.domain,
        remembered=sizes,
    )


def mapped(effect: Effect, x: np.ndarray, record: Record, values: dict[str, float]) -> np.ndarray:
    """What an effect of the error, the command or the output makes of samples."""
    signal = x[:, None]
    if effect.place == "command":
        made = effect.apply(Command(signal, 0.0 * signal, signal, 0.0), record, **values)
        signal = made.position + differentiated(made.rate, record.dt)
    else:
        signal = effect.apply(signal.copy(), record, **values)
    return signal[:, 0]


def find_departure(
    form: FreeForm,
    effect: Effect,
    values: dict[str, float],
    record: Record,
    gains: tuple[float, float] = (1.0, 0.0),
) -> Departure:
    """What an effect adds where a free form has its curve, as a function of the abscissa."""

    def over(at: np.ndarray) -> np.ndarray:
        order = np.argsort(at, kind="stable")
        found = np.empty(at.size)
        there = at[order]
        if form.over == "lag":
            found[order] = _answered(form, effect, values, record, there, gains)
        else:
            found[order] = _sorted_departure(form, effect, values, record, there)
        return found

    return over


def make_pulse(form: FreeForm, at: np.ndarray) -> np.ndarray:
    """A pulse of area one at lag zero, as wide as the curve can resolve."""
    assert form.knots is not None
    width = (form.knots[-1] - form.knots[0]) / (2 * (len(form.knots) - 1))
    return np.exp(-0.5 * (at / width) ** 2) / (width * np.sqrt(2 * np.pi))


def _answered(
    form: FreeForm,
    effect: Effect,
    values: dict[str, float],
    record: Record,
    at: np.ndarray,
    gains: tuple[float, float],
) -> np.ndarray:
    """What follows a pulse of the channel, or of the error: of the command, or of the output."""
    span = at[-1] - at[0]
    t = np.arange(min(at[0], 0.0) - span / 2, at[-1] + span / 2, record.dt)
    pulse = make_pulse(form, t)[:, None]
    channel = getattr(form, "channel", None)
    if form.place == "sum":
        assert channel is not None
        more = effect.apply(0.0 * pulse, bare(record, t, **{channel: pulse}), **values)
        return np.interp(at, t, more[:, 0])
    if channel is None:
        whole = Command(gains[0] * pulse, gains[1] * pulse, pulse, 0.0)
        alone = bare(record, t)
    else:
        whole = Command(0.0 * pulse, 0.0 * pulse, 0.0 * pulse, 0.0)
        alone = bare(record, t, **{channel: pulse})
    made = effect.apply(whole, alone, **values)
    rate = differentiated(made.rate - whole.rate, record.dt)
    return np.interp(at, t, (made.position - whole.position + rate)[:, 0])


def _sorted_departure(
    form: FreeForm, effect: Effect, values: dict[str, float], record: Record, at: np.ndarray
) -> np.ndarray:
    ticks = np.arange(at.size) * record.dt
    if form.name == "free_hysteresis":
        return _loaded(effect, values, record, at)
    if form.name == "free_map" and form.place != "spring":
        return mapped(effect, at, bare(record, ticks), values) - at
    if form.place == "spring":
        force = effect.apply(Spring(), bare(record, ticks), **values)
        rest = np.zeros(at.size)
        return force.force(rest, at) if form.over == "du/dt" else force.force(at, rest)
    alone = bare(record, at) if form.over == "time" else bare(record, ticks, **{form.over: at})
    return _along(form, effect, values, alone, at.size)


def _along(
    form: FreeForm, effect: Effect, values: dict[str, float], record: Record, count: int
) -> np.ndarray:
    """Of a factor on the gains, a delay or an offset."""
    ones = np.ones((count, 1))
    if form.place == "delay":
        found = effect.apply(0.0, record, **values)
    elif form.place == "sum":
        found = effect.apply(0.0 * ones, record, **values)
    elif effect.place == "command":
        made = effect.apply(Command(ones, 0.0 * ones, ones, 0.0), record, **values)
        found = made.position - 1.0
    else:
        made = effect.apply(Gains(ones, ones, ones, ones), record, **values)
        found = (made.rate if getattr(form, "of", "both") == "rate" else made.error) - 1.0
    return np.broadcast_to(found, (count, 1))[:, 0]


def _loaded(effect: Effect, values: dict[str, float], record: Record, at: np.ndarray) -> np.ndarray:
    """What is taken from a signal that leaves rest for the first time, to either side."""
    found = np.zeros(at.size)
    for side in (1.0, -1.0):
        there = side * at >= 0.0
        if there.any():
            ramp = np.linspace(0.0, float(np.abs(at[there]).max()), 2 * N_POINTS)
            ticks = np.arange(ramp.size) * record.dt
            taken = mapped(effect, side * ramp, bare(record, ticks), values) - side * ramp
            found[there] = np.interp(side * at[there], ramp, taken)
    return found
