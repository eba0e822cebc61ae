"""How alike the curve of a free form and that of an effect are, with what a model refits left out.

Both are compared as the model sees them, which refits a gain or a level beside a curve. An effect
``e' = e + delta(e)`` with a gain K is the same as ``e' = e + curve(e)`` with a gain K / factor if
``e + curve(e) = factor (e + delta(e))``; so is one of the gains, with 1 in place of e.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ..effects.base import Effect
from ..effects.free_form import LEVEL, SLOPE, TAIL, FreeForm
from ..effects.operator_signals import Command, Gains, Spring
from ..effects.parameter import CoreKind
from ..effects.record import Record, differentiated

N_POINTS = 60
MOST_STEPS = 25
NOTHING = 1e-6  # of the curve's size, by which an effect that has none may differ
BEYOND = 1e6  # in place of numbers that are not finite
SAME = 1e-9  # of the curve's size
Departure = Callable[[np.ndarray], np.ndarray]  # over any points, of what passes through


class Fit(NamedTuple):
    """The curve of an effect, or of a formula, that lies nearest to that of a free form.

    Attributes
    ----------
    values : ndarray
        Of the parameters.
    acts : ndarray of bool
        Which of them change the curve.
    distance : float
        Rms of the difference, relative to the curve.
    curve : ndarray
        Over the abscissa of the shape's curve, with what the model refits as the shape has it.
    """

    values: np.ndarray
    acts: np.ndarray
    distance: float
    curve: np.ndarray


@dataclass(frozen=True)
class Likeness:
    """A free form's curve, ready to be compared with others.

    Attributes
    ----------
    form : FreeForm
        With its values.
    grid : ndarray
        Abscissa of the curve and its band.
    value : ndarray
        The curve there, without what it is at rest.
    points : ndarray
        Where curves are compared: as dense as the data.
    there : ndarray
        The curve at the points.
    operator : bool
        Whether the model is an operator, whose limb divides by its stiffness.
    """

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
            answer = departure_of(form, of_pulse, {}, record, gains)
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

    def beside(self, at: np.ndarray) -> np.ndarray:
        """What the model refits beside the curve, as columns."""
        if self.form.name == "free_dynamics":  # the gains on error and error rate
            pulse = pulse_of(self.form, at)
            return np.stack([pulse, np.gradient(pulse, at)], axis=1)
        return np.polynomial.polynomial.polyvander(at, 1)[:, list(self.removed)]

    def refitted(self, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """At the points and over the grid, a departure with what the model refits beside it."""
        n, at = self.points.size, self.at
        beside = self.beside(at)
        if self.divides is None:
            factor = np.linalg.lstsq(beside[:n], self.there - delta[:n], rcond=None)[0]
            found = delta + beside @ factor
            return found[:n], found[n:]
        unit = at**self.divides
        others = [k for k, degree in enumerate(self.removed) if degree != self.divides]
        columns = np.column_stack([unit + delta, beside[:, others]])
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
        """The nearest curve of a family; None for a family that has none here.

        ``departure(values)`` is its departure ``at`` all places.
        """
        basis = np.linalg.qr(self.beside(self.points))[0]
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
    """Starts with half as much as is possible, up to one half, where they are zero.

    An effect of size zero has no curve that could lead elsewhere.
    """
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
        _derived=sizes,
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


def departure_of(
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


def pulse_of(form: FreeForm, at: np.ndarray) -> np.ndarray:
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
    pulse = pulse_of(form, t)[:, None]
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
