"""The controlled element estimated from the recorded u and x, and which sample of u moves x first.

Integrals of u and x are compared, so that no signal is differentiated. In a closed loop u responds
to a disturbance that is not recorded, and least squares mistakes some of that response for the
element. Motion due to the target alone is free of this bias: the target is the instrument wherever
it is known. Fast motion is nearly free of it too, since a disturbance is smooth and the response to
it late; it tells forms apart, and where it is clear it gives the gain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ..effects.record import Record
from ..human import LinearElement

FAST = 0.15  # s over which motion is averaged and compared with that before
FEWEST = 50  # known rows of a run
SURE = 3.0  # standard errors
CLOSE = 0.4  # of the share of a sample's answer, to one and to zero


@dataclass(frozen=True)
class FastMotion:
    """Fast motion of x compared with what u would cause through an element.

    ``gain`` is 1 for a true element, ``agreement`` is the squared correlation.
    """

    gain: float
    sd: float
    agreement: float


def compare_fast_motion(
    element: LinearElement, record: Record, u: np.ndarray, x: np.ndarray
) -> FastMotion:
    """Compare changes of denominator x and numerator u, as averages over some samples."""
    b, a = element.discrete(record.dt)
    m = max(1, round(FAST / record.dt))
    made, seen = np.zeros(0), np.zeros(0)
    for j in range(record.n_runs):
        span = find_known_span(record, j)
        if span is not None and span.stop - span.start > b.size + 2 * m:
            made = np.append(made, _changes(np.convolve(u[span, j], b, "valid"), m))
            seen = np.append(seen, _changes(np.convolve(x[span, j], a, "valid"), m))
    power = float(made @ made)
    if not power > 0:
        return FastMotion(0.0, np.inf, 0.0)
    gain = float(made @ seen) / power
    error = seen - gain * made
    # Averages over m samples overlap.
    sd = np.sqrt(float(error @ error) / power / max(len(made) / (2 * m) - 1, 1))
    agreement = 1 - float(error @ error) / max(float(seen @ seen), 1e-300)
    return FastMotion(gain, float(sd), agreement)


def _changes(signal: np.ndarray, m: int) -> np.ndarray:
    averages = np.convolve(signal, np.full(m, 1 / m), "valid")
    return averages[m:] - averages[:-m]


def adopt_element(given: Any, record: Record) -> LinearElement:
    """An element given by the user, with the timing found in the data."""
    element = LinearElement.of(given)
    names = record.with_role("x")
    if not names or record.y is None:
        return element
    return choose_timing(element, record, record.y, record.channels[names[0]])


def choose_timing(
    element: LinearElement, record: Record, u: np.ndarray, x: np.ndarray
) -> LinearElement:
    """The element with ``direct`` from the data: whether x(k) already depends on u(k).

    The part of x that one sample of u moves is compared with u at both samples, by their changes:
    a disturbance is smooth.
    """
    if element.dt is not None or len(element.numerator) == len(element.denominator):
        return element
    b, a = replace(element, direct=False).discrete(record.dt)
    now, before, moved = [], [], []
    for j in range(record.n_runs):
        span = find_known_span(record, j)
        if span is None:
            continue
        # b[0] is zero: the late answer of sample k is the early one of sample k - 1.
        early = np.convolve(u[span, j], b[1:])[b.size : u[span, j].size]
        left = np.convolve(x[span, j], a)[b.size : x[span, j].size]
        early, left = np.diff(early), np.diff(left)
        now.append(early[1:])
        before.append(early[:-1])
        moved.append(left[1:])
    if not now:
        return element
    table = np.stack([np.concatenate(now), np.concatenate(before)], 1)
    answer = np.concatenate(moved)
    share, *_ = np.linalg.lstsq(table, answer, rcond=None)
    error = answer - table @ share
    normal = np.linalg.pinv(table.T @ table)
    contrast = np.array([1.0, -1.0])
    sd = np.sqrt(error @ error / max(len(error) - 2, 1) * contrast @ normal @ contrast)
    # For a true element one share is 1 and the other 0; a wrong element proves nothing.
    surely = share[0] - share[1] > SURE * sd and np.abs(share - [1.0, 0.0]).max() < CLOSE
    return replace(element, direct=bool(surely))


def find_known_span(record: Record, j: int) -> slice | None:
    known = np.flatnonzero(record.known[:, j])
    return slice(known[0], known[-1] + 1) if known.size >= FEWEST else None


WORST_FIT = 0.2  # largest share of the power of x that may stay unexplained
PIECE = 20.0  # s; every piece has a start of its own, so that integrals forget slow errors
PIECE_ROWS = 1200  # at least, on slow clocks
LAGS = np.linspace(0.0, 0.3, 13)  # of the instruments, in pieces
ROWS = 160  # of a piece that count: integrals are smooth
ROUNDING = 1e-13  # of x, below which nothing is left of it but a parabola
WEAK = 0.05  # share of u's integral that the target must move to be an instrument
SIMPLER = 0.6  # of the error of one constant, above which a second is not worth it
EXACT = 1e-6  # share of the power, below which nothing is left for a second constant
CLEAR = 0.8  # agreement of fast motion, by which forms that agree less are told apart
LESS = 0.1  # agreement
TRUSTED = 0.9  # agreement, from which fast motion decides the gain
OFF = 0.4  # of the gain, by which fast motion may contradict


@dataclass(frozen=True)
class Form:
    """A family of elements that is linear in its constants on integrals of u and x.

    x = K times the ``n``-fold integral of u, minus omega_b times the integral of x if ``breaks``.
    """

    n: int
    breaks: bool = False

    def element(self, constants: np.ndarray) -> LinearElement:
        rest = (1.0, float(constants[1])) if self.breaks else (1.0,)
        zeros = self.n - len(rest) + 1
        return LinearElement((float(constants[0]),), rest + (0.0,) * zeros)


FORMS = (Form(1), Form(2), Form(0), Form(2, breaks=True), Form(1, breaks=True))


@dataclass(frozen=True)
class ElementEstimate:
    """An element estimated from data.

    ``constants`` are K, and omega_b in rad/s where the form has one, with standard errors ``sd``;
    ``unexplained`` is the share of the power of x (of what the target moves, with ``instruments``)
    that it does not explain.
    """

    element: LinearElement
    constants: np.ndarray
    sd: np.ndarray
    unexplained: float
    instruments: bool
    disturbance: str | None


def estimate_element(record: Record) -> LinearElement | None:
    """The element from u to x; None where x is not measured or does not follow u linearly."""
    found = search_element(record)
    return None if found is None else found.element


def search_element(record: Record) -> ElementEstimate | None:
    """As :func:`estimate_element`, with errors."""
    names = record.with_role("x")
    if not names or record.y is None:
        return None
    x = record.channels[names[0]]
    found = [
        _estimate(record, x, disturbance) for disturbance in (*record.with_role("dist")[:1], None)
    ]
    return min((f for f in found if f is not None), key=lambda f: f.unexplained, default=None)


def _estimate(record: Record, x: np.ndarray, disturbance: str | None) -> ElementEstimate | None:
    """The best element for one disturbance, or for none, with the timing of its input."""
    assert record.y is not None
    u = record.y if disturbance is None else record.y + record.channels[disturbance]
    late = _Search.of(record, u, x, disturbance)
    found = None if late is None else late.best()
    if found is None or not choose_timing(found.element, record, u, x).direct:
        return found
    early = _Search.of(record, np.concatenate([u[1:], u[-1:]]), x, disturbance)
    found = None if early is None else early.best()
    return found and replace(found, element=replace(found.element, direct=True))


@dataclass(frozen=True)
class _Table:
    """Rows of all pieces: x, integrals of u and of x, instruments; without their parabolas.

    ``of_u`` are u and its first and second integral.
    """

    x: np.ndarray
    of_u: np.ndarray
    integral_of_x: np.ndarray
    instruments: np.ndarray | None
    piece: np.ndarray

    @classmethod
    def of(cls, record: Record, u: np.ndarray, x: np.ndarray) -> _Table | None:
        names = record.with_role("f_t")
        target = record.channels[names[0]] if names else None
        length = max(round(PIECE / record.dt), PIECE_ROWS)
        blocks: list[np.ndarray] = []
        labels: list[np.ndarray] = []
        for j in range(record.n_runs):
            span = find_known_span(record, j)
            if span is None:
                continue
            for piece in _cut(span, length):
                columns = _integrate_twice(u[piece, j], record.dt)
                columns += [x[piece, j], _integrate(x[piece, j], record.dt)]
                if target is not None:
                    columns += _lag(target[span, j], piece, span, length, record.dt)
                block = np.stack(columns, 1)
                # Start, speed, and the second integral of a constant disturbance.
                still = np.vander(np.linspace(-1.0, 1.0, len(block)), 3)
                block = block - still @ np.linalg.lstsq(still, block, rcond=None)[0]
                blocks.append(block[:: max(1, length // ROWS)].copy())
                labels.append(np.full(len(blocks[-1]), len(labels)))
        if not blocks:
            return None
        rows = np.concatenate(blocks)
        if np.abs(rows[:, 3]).max() <= ROUNDING * np.nanmax(np.abs(x)):
            return None  # it rests, or moves as if nothing moved it
        instruments = None
        if target is not None:
            size = np.sqrt((rows[:, 5:] ** 2).mean(axis=0))
            kept = size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)
            base, values, _ = np.linalg.svd(rows[:, 5:][:, kept] / size[kept], full_matrices=False)
            base = base[:, values > 1e-6 * values.max(initial=0.0)]
            moved = base @ (base.T @ rows[:, 1])
            if base.size and moved @ moved > WEAK * (rows[:, 1] @ rows[:, 1]):
                instruments = base
        return cls(rows[:, 3], rows[:, :3], rows[:, 4], instruments, np.concatenate(labels))

    def seen(self, rows: np.ndarray) -> np.ndarray:
        """The part that the instruments move; all of it without any."""
        if self.instruments is None:
            return rows
        return self.instruments @ (self.instruments.T @ rows)


@dataclass(frozen=True)
class _Search:
    """One assumption about what moves x, and the forms fitted under it."""

    record: Record
    u: np.ndarray
    x: np.ndarray
    disturbance: str | None
    table: _Table

    @classmethod
    def of(
        cls, record: Record, u: np.ndarray, x: np.ndarray, disturbance: str | None
    ) -> _Search | None:
        table = _Table.of(record, u, x)
        return None if table is None else cls(record, u, x, disturbance, table)

    def best(self) -> ElementEstimate | None:
        """The simplest form among those about as good as the best; None where none is good."""
        fits = [(form, self.fitted(form)) for form in FORMS]
        fits = [(form, fit) for form, fit in fits if (fit.constants > 0)[1:].all()]
        fast = [self.fast(fit) for _, fit in fits]
        top = max(one.agreement for one in fast)
        able = [
            case
            for case, one in zip(fits, fast, strict=True)
            if top < CLEAR or one.agreement > top - LESS
        ]
        plain = [c for c in able if not c[0].breaks]
        form, best = min(plain, key=lambda c: c[1].unexplained, default=(None, None))
        for other, fit in able:
            surely = other.breaks and fit.constants[1] > SURE * fit.sd[1]
            if best is None or (surely and EXACT < SIMPLER * best.unexplained > fit.unexplained):
                form, best = other, fit
        if form is None or best is None:
            return None
        return self.decided(form, best)

    def decided(self, form: Form, fit: ElementEstimate) -> ElementEstimate | None:
        """The fit with the gain of fast motion where that is clear; None where they disagree."""
        fast = self.fast(fit)
        if fast.agreement > TRUSTED:
            gain, sd = fit.constants[0] * fast.gain, abs(fit.constants[0]) * fast.sd
            if abs(gain - fit.constants[0]) < SURE * np.hypot(sd, fit.sd[0]):
                weights = np.array([sd, fit.sd[0]]) ** -2.0 if sd * fit.sd[0] > 0 else np.ones(2)
                gain = float(weights @ [gain, fit.constants[0]]) / float(weights.sum())
                sd = float(weights.sum()) ** -0.5
            refined = self.fitted(form, gain)
            return replace(refined, sd=np.concatenate([[sd], refined.sd[1:]]))
        clear = abs(fit.constants[0]) > SURE * fit.sd[0] and fit.unexplained < WORST_FIT
        return fit if clear and abs(fast.gain - 1) < max(OFF, SURE * fast.sd) else None

    def fast(self, fit: ElementEstimate) -> FastMotion:
        return compare_fast_motion(fit.element, self.record, self.u, self.x)

    def fitted(self, form: Form, gain: float | None = None) -> ElementEstimate:
        """Constants by least squares on what the instruments move; the gain may be given."""
        table = self.table
        target, columns = table.x, [table.of_u[:, form.n]]
        known = [] if gain is None else [gain]
        if gain is not None:
            target, columns = target - gain * columns[0], []
        if form.breaks:
            columns.append(-table.integral_of_x)
        regressors = np.stack(columns, 1) if columns else np.zeros((target.size, 0))
        moved = table.seen(regressors)
        size = np.linalg.norm(moved, axis=0)  # the columns have units of their own
        size = np.where(size > 0, size, 1.0)
        moved = moved / size
        solved = np.linalg.lstsq(moved, target, rcond=None)[0] / size
        error = target - regressors @ solved
        scores = np.zeros((int(table.piece[-1]) + 1, len(solved)))
        np.add.at(scores, table.piece, moved * error[:, None])
        spread = scores @ np.linalg.pinv(moved.T @ moved, hermitian=True)
        left, all_of_it = table.seen(error), table.seen(table.x)
        constants = np.array([*known, *solved])
        return ElementEstimate(
            element=form.element(constants),
            constants=constants,
            sd=np.array([0.0 for _ in known] + list(np.linalg.norm(spread, axis=0) / size)),
            unexplained=float(left @ left) / max(float(all_of_it @ all_of_it), 1e-300),
            instruments=table.instruments is not None,
            disturbance=self.disturbance,
        )


def _integrate(signal: np.ndarray, dt: float) -> np.ndarray:
    return cumulative_trapezoid(signal, dx=dt, initial=0)


def _integrate_twice(u: np.ndarray, dt: float) -> list[np.ndarray]:
    """u, its integral and the integral of that, with u held from each sample to the next."""
    once = LinearElement((1.0,), (1.0, 0.0)).answer(u, dt)
    return [u, once, LinearElement((1.0,), (1.0, 0.0, 0.0)).answer(u, dt)]


def _lag(target: np.ndarray, piece: slice, span: slice, length: int, dt: float) -> list[np.ndarray]:
    """The target and its integrals over a piece, at lags."""
    columns = []
    for lag in np.unique(np.round(LAGS * length).astype(int)):
        rows = np.arange(piece.start, piece.stop) - span.start - lag
        late = target[np.maximum(rows, 0)]
        once = _integrate(late, dt)
        columns += [late, once, _integrate(once, dt)]
    return columns


def _cut(span: slice, length: int) -> list[slice]:
    starts = range(span.start, max(span.stop - length // 2, span.start + 1), length)
    return [slice(s, min(s + length, span.stop)) for s in starts]
