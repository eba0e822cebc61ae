"""The judge by instruments: what a model leaves, along what reaches the loop from outside.

In a closed loop e and x hold earlier remnant, and a fit to them may follow it. Target and
disturbance hold none, nor does a constant. At the true parameters what a free run leaves of u is
the remnant, whatever its inputs are, so nothing of it lies along instruments: target and
disturbance with many lags (two-stage least squares; Van den Hof and Schrama 1993). Squares along
them alone judge a model, with no loop to be solved, and their number is small: for a multisine two
for each line.

Nor does anything of the remnant lie along products of what the instruments explain of e and u. At
the true model nothing is left there, whatever the effect; a name whose form is wrong leaves some,
and nobody has to know the right form to see it.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import svd
from scipy.signal import lfilter

from ..effects.record import LARGE, Record
from ..model.fitting import ALL, Criterion, whitened_derivatives
from ..model.likelihood import usual_starts
from ..model.loop import Loop, find_loop
from ..model.model import Model
from .expected import could_know, expected_evidence
from .judges import BLOCK

# s, after a signal and before it: its means between each two make up any smooth response to it.
LAGS = (
    *(-1.5, -1.0, -0.5, -0.25, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8),
    *(1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 8.0),
)
RATE = 12.5  # Hz: nobody follows what is faster than half of it
SLOW = 0.5  # rad/s, of poles in place of the element's: integrators keep all there was before
DISTURBED = 0.05  # of the power of x: an element 20 % too strong makes up so large a disturbance
# Of the largest singular value, above which lags of a signal are one more instrument: as recorded,
# and as the element tells it, with the output's sampling in it.
RECORDED, TOLD = 1e-3, 0.03
ITERATIONS = (4, 15)  # of all starts, and of the best
SINCE = (0.0, 0.16, 0.32, 0.56, 0.96, 1.6)  # s, in which a person has answered
FORGOTTEN = 2.0  # s, of a running size
ROUNDING = 1e-4  # of the largest eigenvalue of products
SCALES = np.geomspace(1e-3, 1e6, 91)  # of a process, in variances of the noise


class Instruments(Criterion):
    """Squares of whitened residuals along the instruments, of which there are ``n``."""

    def __init__(self, record: Record, instruments: np.ndarray):
        self._along: np.ndarray | None = None
        self._instruments = instruments
        super().__init__(record, rate=RATE / record.time_unit)

    def whiten(self, output: np.ndarray) -> float:
        """Take the noise model that an output leaves; the variance of its residual per instrument.

        It is what blocks of the record have along the instruments, each by itself, so that whatever
        varies from block to block counts as noise.
        """
        self._along = None
        self.set_noise(self.remnant_model(output))
        _, size, along = svd(super().whitened(self._instruments), full_matrices=False)
        self._along = along[size > RECORDED * size[0]]
        self.n = len(self._along)
        return find_variance(super().whitened(self.residual(output)[None]) * self._along, self)

    def whitened(self, signals: np.ndarray, runs: slice = ALL) -> np.ndarray:
        """Signals as their parts along the instruments."""
        rows = super().whitened(signals, runs)
        return rows if self._along is None else rows @ self._along.T


class InstrumentJudge:
    """Asks the instruments of a record about effects that must add ``asked`` nats."""

    def __init__(self, record: Record, instruments: np.ndarray, asked: float):
        self.record, self.instruments, self.asked = record, instruments, asked

    @classmethod
    def of(cls, record: Record, asked: float) -> InstrumentJudge | None:
        """The judge of a record; None where all that is known is moved by the output."""
        record = take_at_once(record)
        found = find_instruments(record)
        return cls(record, found, asked) if len(found) else None

    def evidence(self, parent: Model, model: Model) -> float:
        """What a model adds to its parent, in nats; NaN where the instruments cannot know."""
        before, after = (Model(m.simulator.on_record(self.record), m.fit) for m in (parent, model))
        if not np.isfinite(after.output).all():
            return np.nan
        criterion = Instruments(self.record, self.instruments)
        variance = criterion.whiten(after.output)
        before = fit_from(before, criterion, usual_starts(before.simulator, before.theta))
        usual = usual_starts(after.simulator, after.theta)
        after = fit_from(after, criterion, [*usual, put_values(after, before.values())])
        before = fit_from(before, criterion, [put_values(before, after.values())])
        added = model.n_parameters - parent.n_parameters
        penalty = added / 2 * float(np.log(criterion.n))
        found = (before.sse - after.sse) / (2 * variance) - penalty
        if found >= self.asked:
            return found
        expected = expected_evidence(before, after.at(model.theta), criterion, variance)
        return found if could_know(expected, penalty, self.asked) else np.nan


class Curves:
    """Judges what a model leaves along products of what came from outside: of any other form."""

    def __init__(self, record: Record, judge: InstrumentJudge | None):
        self.record = take_at_once(record) if judge is None else judge.record
        self.outside = None if judge is None else judge.instruments

    @cached_property
    def _found(self) -> tuple[np.ndarray, np.ndarray]:
        """What is linear, and the products."""
        if self.outside is not None:
            return self.outside, find_products(self.record, self.outside)
        return spread_lags(self.record.input, self.record, RECORDED), find_products(self.record)

    def weigh(self, model: Model) -> tuple[float, float]:
        """Nats of another form beside a model, and the share of the squares left that it explains.

        See :func:`weigh_curved`.
        """
        return weigh_curved(model, self.record, *self._found)


def take_at_once(record: Record) -> Record:
    """As many runs as are simulated at once: squares are of all together."""
    most = max(1, LARGE // len(record.known))
    if record.n_runs <= most:
        return record
    return record.part(np.linspace(0, record.n_runs - 1, most).round().astype(int), 1)


def find_variance(parts: np.ndarray, criterion: Criterion) -> float:
    """Variance of a sum of whitened residuals, whose parts at each row are (count, n) here.

    It is what blocks have, each by itself, so that whatever varies between them counts as noise.
    """
    record = criterion.record
    per = round(BLOCK * record.time_unit / (criterion.thin * record.dt))
    blocks = parts.reshape(len(parts), *criterion.y.shape)
    sums = np.add.reduceat(blocks, np.arange(0, len(criterion.y), per), axis=1)
    return float((sums**2).sum()) / len(parts)


def weigh_curved(
    model: Model, record: Record, instruments: np.ndarray, products: np.ndarray
) -> tuple[float, float]:
    """Nats that products explain of what a model leaves, and their share of its squares.

    They are the kernel of a Gaussian process beside the model's parameters, whose scale is fitted:
    the test of a component of variance by its likelihood ratio.
    """
    criterion = Criterion(record, rate=RATE / record.time_unit)
    model = Model(model.simulator.on_record(record), model.fit)
    criterion.set_noise(criterion.remnant_model(model.output))
    *own, left = whitened_derivatives(model.simulator, criterion, model.theta)
    beside, _ = np.linalg.qr(np.stack([*own, *criterion.whitened(instruments)], axis=1))
    left = left - beside @ (beside.T @ left)
    rows = criterion.whitened(products)
    whole = (rows**2).sum(axis=1)
    rows -= (rows @ beside) @ beside.T
    rows /= np.sqrt(np.maximum((rows**2).sum(axis=1), TOLD * whole) + 1e-300)[:, None]
    power, along = np.linalg.eigh(rows @ rows.T)
    kept = power > ROUNDING * max(power[-1], 1e-300)
    if not kept.any() or left @ left <= np.finfo(float).eps * criterion.power:
        return 0.0, 0.0  # nothing came from outside, or nothing is left
    power = power[kept]
    rows = (along[:, kept].T @ rows) / np.sqrt(power)[:, None]
    signal = (rows @ left) ** 2
    size = SCALES[:, None] * power / power[-1]
    seen = signal / find_variance(rows * left, criterion)
    nats = (seen * size / (1 + size) - np.log1p(size)).sum(axis=1) / 2
    best = int(np.argmax(nats))
    taken = signal @ (1 - 1 / (1 + size[best]) ** 2)
    return max(float(nats[best]), 0.0), float(taken / (left @ left))


def find_products(record: Record, instruments: np.ndarray | None = None) -> np.ndarray:
    """What instruments explain of e, u, x and rates, times each other, their sizes, and time.

    Without any, e and x as they are: what a noise model leaves is independent of all that was
    before. At lags, of shape (count, n_samples, n_runs), on the rows of :class:`Instruments`.
    """
    criterion = Criterion(record, rate=RATE / record.time_unit)
    known, dt = criterion.known, criterion.thin * record.dt / record.time_unit
    moved = [record.input, *(record.channels[name] for name in record.with_role("x")[:1])]
    moved = [one[:: criterion.thin] * known for one in moved]
    if instruments is not None:
        basis, _ = np.linalg.qr(instruments.reshape(len(instruments), -1).T)
        moved = [basis @ (basis.T @ one.ravel()) for one in [*moved, criterion.y * known]]
        moved = [one.reshape(known.shape) for one in moved]

    def scale(signal: np.ndarray) -> np.ndarray:
        signal = signal - signal[known].mean()
        return np.asarray(signal / max(float(np.sqrt((signal[known] ** 2).mean())), 1e-300))

    signals = [scale(s) for one in moved for s in (one, np.gradient(one, dt, axis=0))]
    keeps = np.exp(-dt / FORGOTTEN)
    size = np.sqrt(lfilter([1 - keeps], [1, -keeps], signals[0] ** 2, axis=0))
    time = np.broadcast_to(np.linspace(-1, 1, len(known))[:, None], known.shape)
    factors = [*map(np.abs, signals), scale(size), time, time**2]
    products = [a * b for a, b in combinations_with_replacement(signals, 2)]
    products += [factor * signal for factor in factors for signal in signals]
    since = SINCE if instruments is not None else SINCE[1:]
    lags = [round(lag / dt) for lag in since]
    late = [np.pad(one, [(lag, 0), (0, 0)])[: len(one)] * known for lag in lags for one in products]
    return np.asarray(late)


def fit_from(model: Model, criterion: Criterion, starts: Iterable[np.ndarray]) -> Model:
    """A model at the best minimum from its parameters and further starts."""
    first, then = ITERATIONS
    tried = [model.at(theta).refined(criterion, first) for theta in (model.theta, *starts)]
    return min(tried, key=lambda m: m.sse).refined(criterion, then)


def put_values(model: Model, values: dict[str, float]) -> np.ndarray:
    """A model's parameters, with the values of those that are given."""
    known = {**model.values(), **values}
    return np.array([known[name] for name in model.simulator.names])


def find_instruments(record: Record) -> np.ndarray:
    """A constant, and lags of target and disturbance, as recorded or as the element tells.

    Of shape (count, n_samples, n_runs).
    """
    target = [record.channels[name] for name in record.with_role("f_t")[:1]]
    disturbance = [record.channels[name] for name in record.with_role("dist")]
    found = [spread_lags(signal, record, RECORDED) for signal in target + disturbance]
    if found:
        counts = Criterion(record, rate=RATE / record.time_unit).known.astype(float)
        found.append(counts[None] / np.sqrt(counts.sum()))
    loop = find_loop(record)
    if loop is not None and not (target and disturbance):
        found += [spread_lags(s, record, TOLD) for s in tell_outside(record, loop, bool(target))]
    return np.concatenate(found) if found else np.empty(0)


def tell_outside(record: Record, loop: Loop, target: bool) -> list[np.ndarray]:
    """What the element says came from outside: x - G u where the target is known, else e + G u."""
    assert record.y is not None
    order = len(loop.a) - 1
    settling = np.poly(np.full(order, np.exp(-SLOW * record.dt)))

    def settled(b: np.ndarray, signal: np.ndarray) -> np.ndarray:
        """A signal through zeros or poles of the element, its slow poles being at SLOW."""
        rest = lfilter(b, [1.0], signal, axis=0)
        rest[:order] = 0.0  # what preceded the record is not known
        return np.asarray(lfilter([1.0], settling, rest, axis=0))

    moved = settled(loop.b, record.y)
    if not target:
        return [settled(loop.a, record.input) + moved]
    for name in record.with_role("x")[:1]:
        whole = settled(loop.a, record.channels[name])
        power = [float((s[record.known] ** 2).sum()) for s in (whole - moved, whole)]
        if power[0] > DISTURBED * power[1]:
            return [whole - moved]
    return []


def spread_lags(signal: np.ndarray, record: Record, least: float) -> np.ndarray:
    """Means of a signal between each two of ``LAGS``, as far as they differ.

    On the rows of :class:`Instruments`; ``least`` is a share of the largest singular value.
    """
    criterion = Criterion(record, rate=RATE / record.time_unit)
    total = np.cumsum(signal, axis=0)
    late = [record.delayed(total, lag * record.time_unit)[:: criterion.thin] for lag in LAGS]
    means = np.diff(late, axis=0) / np.diff(LAGS)[:, None, None] * criterion.known
    _, size, apart = svd(means.reshape(len(means), -1), full_matrices=False)
    return np.asarray(apart[size > least * size[0]].reshape(-1, *criterion.known.shape))
