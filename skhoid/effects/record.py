"""Runs side by side as arrays, with roles and units: what effects and simulations work on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from .. import _kernels
from ..runs.roles import EXACT, OTHER
from .derived import DERIVED, WINDOW
from .parameter import CoreKind, RoleName

if TYPE_CHECKING:
    from ..human.linear_element import LinearElement


@dataclass(frozen=True, eq=False)
class RowChannels(Mapping[str, np.ndarray]):
    """Channels of runs side by side that are put together when they are asked for.

    ``rows`` gives some rows of each channel, ``begin`` and ``end`` are the first and the last + 1
    of the runs, and ``length`` is the number of samples of the record. ``sums`` are channels that
    are the sum of two others. Of the samples every ``step``-th is taken; 0 takes all, with those
    of a run one after the other. ``given`` are channels with other values. What was ``found`` is
    kept; a part of the runs has its own, and other processes get a plain dict. ``order`` is how
    samples lie in memory: those of very many runs one run after the other, "F".
    """

    rows: Mapping[str, Callable[[slice], np.ndarray]]
    begin: np.ndarray
    end: np.ndarray
    length: int
    sums: Mapping[str, tuple[str, str]]
    step: int = 0
    given: Mapping[str, np.ndarray] = field(default_factory=dict)
    found: dict[str, np.ndarray] = field(default_factory=dict)
    order: Literal["C", "F"] = "F"

    def __iter__(self) -> Iterator[str]:
        yield from dict.fromkeys([*self.rows, *self.sums])

    def __contains__(self, name: object) -> bool:
        return name in self.rows or name in self.sums or name in self.given

    def __len__(self) -> int:
        return len({*self.rows, *self.sums})

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.given and name not in self.found:
            self.found[name] = self.read(name)
        return self.read(name)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)  # kept, so that joblib writes each once for all workers

    def read(self, name: str) -> np.ndarray:
        """The same, and nothing more is kept."""
        if name in self.given:
            return self.given[name]
        if name in self.found:
            return self.found[name]
        one, *other = self.sums.get(name, (name,))
        out = self._beside(one)
        for more in other:
            out += self._beside(more)
        return np.ascontiguousarray(out[:: self.step]) if self.step else out

    def _beside(self, name: str) -> np.ndarray:
        rows = self.rows[name]
        out = np.zeros((self.length, self.begin.size), order=self.order)
        for j, (a, b) in enumerate(zip(self.begin.tolist(), self.end.tolist(), strict=True)):
            out[: b - a, j] = rows(slice(a, b))
        return out

    def of_runs(self, runs: slice | np.ndarray) -> RowChannels:
        """The channels of some of the runs."""
        given = {name: values[:, runs] for name, values in self.given.items()}
        return replace(self, begin=self.begin[runs], end=self.end[runs], given=given, found={})

    def thinned(self, step: int) -> RowChannels:
        """The channels at every ``step``-th sample."""
        given = {n: np.ascontiguousarray(values[::step]) for n, values in self.given.items()}
        return replace(self, step=max(self.step, 1) * step, given=given, found={})

    def beginning(self, n: int) -> RowChannels:
        """The channels at the first ``n`` samples."""
        length = min(self.length, max((n - 1) * max(self.step, 1) + 1, 0))
        return replace(
            self,
            end=np.minimum(self.end, self.begin + length),
            length=length,
            given={name: values[:n] for name, values in self.given.items()},
            found={},
        )

    def changed(self, channels: Mapping[str, np.ndarray]) -> RowChannels:
        """The same with other values of some channels; it shares what is found of the others."""
        return replace(self, given={**self.given, **channels})


FOLLOWS = "follows"  # key of what is remembered of signals that follow from channels
LARGE = 150_000  # samples, above which runs are simulated a few at a time
CACHED = 80_000  # samples of these few: their signals stay in a processor's cache


@dataclass(frozen=True)
class Record:
    """Channels of runs side by side, as arrays of shape (n_samples, n_runs).

    A gap begins a new run here. Runs shorter than the longest are zero at the end, and not
    ``known`` there.

    Attributes
    ----------
    dt : float
        Sampling time in seconds.
    t : ndarray of shape (n_samples, 1 or n_runs)
        Time in the run, in seconds.
    channels : mapping of str to ndarray of shape (n_samples, n_runs)
        All channels, by name; those of a table are read when they are asked for.
    roles : dict of str to str
        Role of each channel; ``""`` for those without.
    inputs : tuple of str
        Names of the linear inputs.
    known : ndarray of bool, shape (n_samples, n_runs)
        Samples at which the output counts.
    y : ndarray of shape (n_samples, n_runs) or None
        Measured output, zero where unknown.
    weights : ndarray of shape (n_samples, n_runs) or None
        What squares count, 1 on average; None for 1 everywhere.
    controlled_element : LinearElement or None
        What makes x of the output u.
    prediction : ndarray of shape (n_samples, n_runs) or None
        What a model without the effect predicts.
    core : CoreKind
        What effects act on: OPERATOR, whether its delay is given or not, or ARX. The command of an
        operator is in units of the output, that of an ARX model in units of its input.
    time_unit : float
        Seconds in which bounds and starts of times are meant: 1 for operators.
    criterion_rate : float
        Rate in Hz at which residuals count, at most.
    ahead : float
        Seconds by which the response may come earlier than the core's delay.
    least_delay : float
        Earliest response, in seconds, to what the output moves.
    initial : {"rest", "held", "estimate", "lasting"}
        How free runs begin; see ``skhoid.model.initial``.
    levels : (float, float)
        Range of the outputs from which a run may begin where its inputs are held.
    begun : float
        What an integral adds to the output at the start of runs where that is not estimated.
    domain : {"human", "machine"}
        What was recorded, for words and for which effects a search tries.
    remembered : dict
        What was computed of it, by key; a record with other numbers begins with none.
    """

    dt: float
    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    roles: Mapping[str, str]
    inputs: tuple[str, ...]
    known: np.ndarray
    y: np.ndarray | None = None
    weights: np.ndarray | None = None
    controlled_element: LinearElement | None = None
    prediction: np.ndarray | None = None
    core: CoreKind = CoreKind.OPERATOR
    time_unit: float = 1.0
    criterion_rate: float = 25.0  # operators do not respond faster than half of it
    ahead: float = np.inf
    least_delay: float = 0.0
    initial: str = "rest"
    levels: tuple[float, float] = (0.0, 0.0)
    begun: float = 0.0
    domain: str = "human"
    remembered: dict = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "remembered": {}}

    def part(self, runs: np.ndarray, thin: int) -> Record:
        """Some of the runs, keeping every ``thin``-th sample."""

        def thinned(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values[::thin])

        channels = self._find_channels(runs)
        return replace(
            self,
            dt=self.dt * thin,
            t=thinned(self.t if self.t.shape[1] == 1 < self.n_runs else self.t[:, runs]),
            channels=channels.thinned(thin)
            if isinstance(channels, RowChannels)
            else {name: thinned(values) for name, values in channels.items()},
            known=thinned(self.known[:, runs]),
            y=None if self.y is None else thinned(self.y[:, runs]),
            weights=None if self.weights is None else thinned(self.weights[:, runs]),
            prediction=None,
            remembered={},
        )

    def _find_channels(self, runs: slice | np.ndarray) -> Mapping[str, np.ndarray]:
        if isinstance(self.channels, RowChannels):
            return self.channels.of_runs(runs)
        return {
            name: values if values.shape[1] == 1 < self.n_runs else values[:, runs]
            for name, values in self.channels.items()
        }

    def changed(self, channels: Mapping[str, np.ndarray]) -> Record:
        """The record with other values of some channels."""
        many = self.channels if isinstance(self.channels, RowChannels) else None
        new = {**self.channels, **channels} if many is None else many.changed(channels)
        return replace(self, channels=new, remembered={})

    def few_runs(self) -> list[slice]:
        """Columns of a few runs at a time, of a large record; none of one that is small."""
        return few_runs(*self.known.shape)

    def columns(self, columns: slice) -> Record:
        """Some of the runs, as views."""
        return replace(
            self,
            t=self.t if self.t.shape[1] == 1 else self.t[:, columns],
            channels=self._find_channels(columns),
            known=self.known[:, columns],
            y=None if self.y is None else self.y[:, columns],
            weights=None if self.weights is None else self.weights[:, columns],
            prediction=None,
            remembered=self.once(("columns", columns.start), dict),
        )

    def forget(self) -> None:
        """Keep no channel that can be read again, and none that follows from others."""
        if isinstance(self.channels, RowChannels):
            self.channels.found.clear()
        for key in [key for key in self.remembered if isinstance(key, tuple) and FOLLOWS in key]:
            del self.remembered[key]

    def beginning(self, seconds: float) -> Record:
        """The first seconds of the runs."""
        n = min(round(min(seconds, self.duration) / self.dt), self.known.shape[0])
        channels = self.channels
        return replace(
            self,
            t=self.t[:n],
            channels=channels.beginning(n)
            if isinstance(channels, RowChannels)
            else {name: values[:n] for name, values in channels.items()},
            known=self.known[:n],
            y=None if self.y is None else self.y[:n],
            weights=None if self.weights is None else self.weights[:n],
            prediction=None,
            remembered={},
        )

    @property
    def n_runs(self) -> int:
        return self.known.shape[1]

    @property
    def duration(self) -> float:
        """Length of the longest run in seconds."""
        return self.known.shape[0] * self.dt

    @property
    def input(self) -> np.ndarray:
        """The first linear input."""
        return self.channels[self.inputs[0]]

    def channel(self, name: str | None) -> np.ndarray:
        """A channel by its name, which a choice has set, or a signal that follows from channels."""
        assert name is not None
        if name in self.channels:
            return self.channels[name]
        return self.once((FOLLOWS, name), lambda: self._derived(name))

    def has(self, name: str) -> bool:
        """Whether there is a channel, or those that a derived signal follows from."""
        if name in self.channels:
            return True
        return name in DERIVED and bool(self._sources(DERIVED[name].role))

    def _sources(self, role: str) -> list[str]:
        """The channel of a role, or the target and the error, whose difference x is."""
        found = self.with_role(role)[:1]
        if not found and role == "x" and self.with_role("f_t") and self.with_role("e"):
            return [self.with_role("f_t")[0], self.with_role("e")[0]]
        return found

    def _derived(self, name: str) -> np.ndarray:
        derived = DERIVED[name]
        one, *less = (self.channels[source] for source in self._sources(derived.role))
        window = max(round(WINDOW * self.time_unit / self.dt), 1)
        signal = one - less[0] if less else one
        return derived.of(differentiated(signal, self.dt) if derived.per_second else signal, window)

    def glance(self, name: str) -> np.ndarray:
        """A channel that is not kept, where it can be read again."""
        channels = self.channels
        if name not in channels:
            return self.channel(name)
        return channels.read(name) if isinstance(channels, RowChannels) else channels[name]

    def with_role(self, role: str) -> list[str]:
        """Names of channels of a role: exactly for e, x and f_t, by prefix for motion and dist."""
        whole = role in (*EXACT, OTHER)
        return [n for n, r in self.roles.items() if (r == role if whole else r.startswith(role))]

    def named(self, name: str) -> str:
        """The channel that a name means: the role "x" or "f_t" of a dimension is one too."""
        if name == "e" or name not in EXACT:
            return name
        of_role = isinstance(name, RoleName) or name not in self.channels
        return next(iter(self.with_role(name)), name) if of_role else name

    def sd(self, name: str) -> float:
        """Standard deviation of a channel, of the input for "e", of the output for "u".

        ``Dimension.of_role`` names a channel by its role.
        """
        channel = self.named(name)
        return self.once(("sd", channel), lambda: self._sd(channel))

    def _sd(self, name: str) -> float:
        if name == "u":
            values = self.y if self.y is not None else np.zeros_like(self.known, dtype=float)
        else:
            values = self.glance(self.inputs[0] if name == "e" else name)
        known = values[self.known]
        return float(np.std(known)) or 1.0 if known.size else 1.0

    def rate(self, name: str) -> np.ndarray:
        """Rate of a channel per second, by central differences."""
        return self.once(("rate", name), lambda: differentiated(self.channels[name], self.dt))

    def inverse_dynamics(self, name: str) -> np.ndarray:
        """Output that makes the controlled element follow a channel (needs the element)."""

        def invert() -> np.ndarray:
            assert self.controlled_element is not None
            return self.controlled_element.inverse(self.channels[name], self.dt)

        return self.once(("inverse", name), invert)

    def delayed(self, signal: np.ndarray, delay: float | np.ndarray) -> np.ndarray:
        """A signal some seconds ago; negative delays look ahead."""
        samples = np.atleast_2d(np.asarray(delay, dtype=float)) / self.dt
        late = _kernels.greybox.delayed(_kernels.gate(signal), _kernels.gate(samples))
        if (
            self.core == CoreKind.ARX and self.initial == "rest"
        ):  # zero before the recording, like its lags
            late *= np.clip(1.0 + np.arange(late.shape[0])[:, None] - samples, 0.0, 1.0)
        return late

    def once(self, key: Any, compute: Callable[[], Any]) -> Any:
        """What ``compute`` returns, computed once for a key."""
        if key not in self.remembered:
            self.remembered[key] = compute()
        return self.remembered[key]


def few_runs(n_samples: int, n_runs: int) -> list[slice]:
    """Columns of a few runs at a time, of a large record; none of one that is small."""
    width = max(1, CACHED // max(n_samples, 1))
    if n_samples * n_runs <= LARGE or n_runs <= width:
        return []
    return [slice(first, min(first + width, n_runs)) for first in range(0, n_runs, width)]


def differentiated(signal: np.ndarray, dt: float) -> np.ndarray:
    """Central differences along time."""
    return np.gradient(signal, dt, axis=0) if len(signal) > 1 else np.zeros(signal.shape)


PILED = 0.02  # least share of the samples that lie at a stop
AT_STOP = 1e-3  # standard deviations of the output within which a sample lies at a stop
NEAR_STOP = 0.05  # the same for samples a little below
PILED_RATES = 0.10  # least share of the rates that lie at the greatest rate
RECURRING = 0.02  # distinct values are levels if fewer than this share of the samples
COARSE = 0.1  # least step, in standard deviations of the output


@dataclass(frozen=True)
class Signature:
    """What a residual shows of an effect that is noise to the free run.

    Parameters
    ----------
    where : str
        Over what it shows, such as ``"frequency"``.
    share : float
        Of the output's variance.
    words : str
        What is seen, for tables.
    parameters : str
        Values of the effect's parameters with their units, for tables.

    See Also
    --------
    Effect : Its ``signature`` returns one.

    Examples
    --------
    >>> from skhoid.effects import Signature
    >>> Signature("frequency", 0.02, "a line at 9.0 Hz", "frequency = 9.00 Hz").share
    0.02
    """

    where: str
    share: float
    words: str
    parameters: str


def find_step(record: Record) -> float | None:
    """Typical distance between the levels that the output takes; None where it takes too many."""
    return record.once("step", lambda: _step(record))


def _step(record: Record) -> float | None:
    y, spread = _output(record)
    if spread == 0.0:
        return None
    rounded = np.unique(np.round(y / spread, 6))
    if rounded.size < 2 or rounded.size > RECURRING * y.size:
        return None
    step = float(np.median(np.diff(rounded)))
    return step * spread if step > COARSE else None


class Stop(NamedTuple):
    """Samples of the output at a stop.

    Attributes
    ----------
    share : float
        Of all samples.
    limit : float
        Size of the output there.
    where : str
        The stop in words, with its sign: both where the output stops to either side.
    """

    share: float
    limit: float
    where: str


def find_stop(record: Record) -> Stop | None:
    """Where samples of the output pile up; None where they do not."""
    return record.once("stop", lambda: _stop(record))


def _stop(record: Record) -> Stop | None:
    y, spread = _output(record)
    if spread == 0.0 or find_step(record) is not None:
        return None
    found = []
    for side in (1.0, -1.0):
        top = float(np.max(side * y))
        below = top - side * y
        there = float(np.mean(below < AT_STOP * spread))
        near = float(np.mean(below < NEAR_STOP * spread)) - there
        # A wave that turns is slow at its top too, but as many samples are a little below.
        if top > 0.0 and there > PILED / 2 and there > near:
            found.append((there, top, side))
    if not found:
        return None
    share, limit, side = max(found)
    where = f"{side * limit:.3g}"
    if len(found) == 2 and abs(found[0][1] - found[1][1]) < NEAR_STOP * spread:
        share, where = found[0][0] + found[1][0], f"±{limit:.3g}"
    return Stop(share, limit, where) if share > PILED else None


def find_fastest(record: Record) -> tuple[float, float] | None:
    """Share of the rates that lie at the greatest rate, and that rate per second."""
    return record.once("fastest", lambda: _fastest(record))


def _fastest(record: Record) -> tuple[float, float] | None:
    if record.y is None or find_step(record) is not None:
        return None
    rates = np.abs(np.diff(record.y, axis=0))[record.known[1:] & record.known[:-1]] / record.dt
    top = float(np.quantile(rates, 0.998)) if rates.size else 0.0
    if not top > 0.0:
        return None
    share = float(np.mean(np.abs(rates - top) < 2e-3 * top))
    return (share, top) if share > PILED_RATES else None


def _output(record: Record) -> tuple[np.ndarray, float]:
    if record.y is None:
        return np.zeros(1), 0.0
    y = record.y[record.known]
    return y, float(np.std(y)) if y.size else 0.0


def needs_channel(channel: str | None, record: Record, role: str, what: str) -> str | None:
    """Why a channel that an effect needs is not there."""
    if channel is not None and not record.has(channel):
        return f"X has no channel {channel!r}"
    if channel is None and not record.with_role(role):
        return f"X has no {what}"
    return None
