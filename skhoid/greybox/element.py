"""The controlled element estimated from the recorded u and x, and which sample of u moves x first.

Integrals of u and x stand on both sides, so that no signal is differentiated. In a closed loop u
answers a disturbance that is recorded nowhere; least squares then takes some of the answer for the
element. What the target alone moves is free of that: it is the instrument wherever it is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ..effects.record import Record
from ..human import LinearElement, as_element

WORST_FIT = 0.2  # largest share of the power of x that may stay unexplained
PIECE = 20.0  # s; every piece has a start of its own, so that integrals forget slow errors
PIECE_ROWS = 400  # at least, on slow clocks
FEWEST = 50  # known rows of a run
LAGS = np.linspace(0.0, 0.3, 13)  # of the instruments, in pieces
ROWS = 160  # of a piece that count: integrals are smooth
WEAK = 0.05  # share of u's integral that the target must move to be an instrument
SIMPLER = 0.6  # of the error of one constant, above which a second is not worth it
EXACT = 1e-6  # share of the power, below which nothing is left for a second constant
SURE = 3.0  # standard errors
CLOSE = 0.4  # of the share of a sample's answer, to one and to zero


@dataclass(frozen=True)
class Form:
    """A family of elements that is linear in its constants on integrals of u and x.

    x = K times the ``n``-fold integral of u, less omega_b times the integral of x if ``breaks``.
    """

    n: int
    breaks: bool = False

    def element(self, constants: np.ndarray) -> LinearElement:
        rest = (1.0, float(constants[1])) if self.breaks else (1.0,)
        zeros = self.n - len(rest) + 1
        return LinearElement((float(constants[0]),), rest + (0.0,) * zeros)


SIMPLE = (Form(1), Form(2), Form(0))
WITH_BREAK = (Form(2, breaks=True), Form(1, breaks=True))


@dataclass(frozen=True)
class ElementEstimate:
    """An element estimated from data.

    ``constants`` are K, and omega_b in rad/s where the form has one, with standard errors ``sd``;
    ``unexplained`` is the share of the power of x (of what the target moves, with ``instruments``)
    that it does not explain; ``disturbance`` is the channel that adds to u.
    """

    element: LinearElement
    constants: np.ndarray
    sd: np.ndarray
    unexplained: float
    instruments: bool
    disturbance: str | None


def estimate_element(record: Record) -> LinearElement | None:
    """The element from u to x; None where x is not measured or does not answer u linearly."""
    found = element_estimate(record)
    return None if found is None else found.element


def element_estimate(record: Record) -> ElementEstimate | None:
    """As :func:`estimate_element`, with errors."""
    names = record.with_role("x")
    if not names or record.y is None:
        return None
    x = record.channels[names[0]]
    found = [
        _estimated(record, x, disturbance) for disturbance in (*record.with_role("dist")[:1], None)
    ]
    best = min((f for f in found if f is not None), key=_unexplained, default=None)
    return None if best is None or best.unexplained > WORST_FIT else best


def _estimated(record: Record, x: np.ndarray, disturbance: str | None) -> ElementEstimate | None:
    """The best element for one disturbance, or for none, with the timing of its input."""
    assert record.y is not None
    u = record.y if disturbance is None else record.y + record.channels[disturbance]
    late = _best_form(_Table.of(record, u, x), disturbance)
    if late is None or not with_timing(late.element, record, u, x).direct:
        return late
    early = _best_form(_Table.of(record, np.concatenate([u[1:], u[-1:]]), x), disturbance)
    return early and replace(early, element=replace(early.element, direct=True))


def given_element(given: Any, record: Record) -> LinearElement:
    """An element that the user gave, with the timing that the data have."""
    element = as_element(given)
    names = record.with_role("x")
    if not names or record.y is None:
        return element
    return with_timing(element, record, record.y, record.channels[names[0]])


def with_timing(
    element: LinearElement, record: Record, u: np.ndarray, x: np.ndarray
) -> LinearElement:
    """The element with ``direct`` as the data have it: whether x(k) answers u(k) already.

    The part of x that one sample of u moves is compared with u at both samples, by their changes:
    a disturbance is smooth.
    """
    if element.dt is not None or len(element.numerator) == len(element.denominator):
        return element
    b, a = replace(element, direct=False).discrete(record.dt)
    now, before, moved = [], [], []
    for j in range(record.n_runs):
        span = _known_span(record, j)
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
    # Of a true element one share is 1 and the other 0; a wrong one is no evidence.
    surely = share[0] - share[1] > SURE * sd and np.abs(share - [1.0, 0.0]).max() < CLOSE
    return replace(element, direct=bool(surely))


def _known_span(record: Record, j: int) -> slice | None:
    known = np.flatnonzero(record.known[:, j])
    return slice(known[0], known[-1] + 1) if known.size >= FEWEST else None


@dataclass(frozen=True)
class _Table:
    """Rows of all pieces: x, integrals of u and of x, instruments; without their straight lines.

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
            span = _known_span(record, j)
            if span is None:
                continue
            for piece in _pieces(span, length):
                columns = _integrals(u[piece, j], record.dt)
                columns += [x[piece, j], _integral(x[piece, j], record.dt)]
                if target is not None:
                    columns += _lagged(target[span, j], piece, span, length, record.dt)
                block = np.stack(columns, 1)
                t = np.linspace(-1.0, 1.0, len(block))
                line = np.stack([np.ones_like(t), t], 1)
                block = block - line @ np.linalg.lstsq(line, block, rcond=None)[0]
                blocks.append(block[:: max(1, length // ROWS)])
                labels.append(np.full(len(blocks[-1]), len(labels)))
        if not blocks:
            return None
        rows = np.concatenate(blocks)
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


def _best_form(table: _Table | None, disturbance: str | None) -> ElementEstimate | None:
    """The simplest form among those about as good as the best."""
    if table is None:
        return None

    def fitted(form: Form) -> ElementEstimate:
        return _fitted(table, form, disturbance)

    simple = min(map(fitted, SIMPLE), key=_unexplained)
    other = [f for f in map(fitted, WITH_BREAK) if f.constants[1] > SURE * f.sd[1]]
    better = min(other, key=_unexplained, default=simple)
    worth_it = better.unexplained < SIMPLER * simple.unexplained and simple.unexplained > EXACT
    best = better if worth_it else simple
    return best if abs(best.constants[0]) > SURE * best.sd[0] else None


def _fitted(table: _Table, form: Form, disturbance: str | None) -> ElementEstimate:
    columns = [table.of_u[:, form.n]] + ([-table.integral_of_x] if form.breaks else [])
    regressors = np.stack(columns, 1)
    moved = table.seen(regressors)
    constants, *_ = np.linalg.lstsq(moved, table.x, rcond=None)
    error = table.x - regressors @ constants
    inverse = np.linalg.pinv(moved.T @ moved)
    scores = np.zeros((int(table.piece[-1]) + 1, len(constants)))
    np.add.at(scores, table.piece, moved * error[:, None])
    covariance = inverse @ (scores.T @ scores) @ inverse
    left, all_of_it = table.seen(error), table.seen(table.x)
    return ElementEstimate(
        element=form.element(constants),
        constants=constants,
        sd=np.sqrt(np.diag(covariance)),
        unexplained=float(left @ left) / max(float(all_of_it @ all_of_it), 1e-300),
        instruments=table.instruments is not None,
        disturbance=disturbance,
    )


def _unexplained(found: ElementEstimate) -> float:
    return found.unexplained


def _integral(signal: np.ndarray, dt: float) -> np.ndarray:
    return cumulative_trapezoid(signal, dx=dt, initial=0)


def _integrals(u: np.ndarray, dt: float) -> list[np.ndarray]:
    """u, its integral and the integral of that, with u held from each sample to the next."""
    once = LinearElement((1.0,), (1.0, 0.0)).answer(u, dt)
    return [u, once, LinearElement((1.0,), (1.0, 0.0, 0.0)).answer(u, dt)]


def _lagged(
    target: np.ndarray, piece: slice, span: slice, length: int, dt: float
) -> list[np.ndarray]:
    """The target and its integrals over a piece, at lags."""
    columns = []
    for lag in np.unique(np.round(LAGS * length).astype(int)):
        rows = np.arange(piece.start, piece.stop) - span.start - lag
        late = target[np.maximum(rows, 0)]
        once = _integral(late, dt)
        columns += [late, once, _integral(once, dt)]
    return columns


def _pieces(span: slice, length: int) -> list[slice]:
    starts = range(span.start, max(span.stop - length // 2, span.start + 1), length)
    return [slice(s, min(s + length, span.stop)) for s in starts]
