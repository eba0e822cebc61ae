"""What a search ends with in numbers: its steps walked again, structure left, the ceiling."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from ..diagnosis.ceiling import consistent_ceiling, noise_ceiling
from ..diagnosis.signals import RunsRead, prepare_signals
from ..effects.base import Effect
from ..effects.composition import Effects
from ..effects.free_forms import shakes
from ..effects.operator_signals import Gains
from ..effects.record import Record, Signature, differentiated
from ..model.estimator import GreyBox, vaf_of_output
from ..model.extend import refit_on_all_runs
from ..model.fitting import Criterion, derivatives
from ..model.loop import LoopSimulator
from ..model.model import Model
from ..model.prepared import Prepared
from ..model.simulator import Simulator
from ..runs.roles import OTHER
from .data import Held
from .judges import RATES, HeldOutRows, LoopJudge, noises_in
from .judging import LEAST_GAIN, THRESHOLD
from .path import Path, further_changes
from .steps import Search, SearchStep

LEFT_SURELY = 4.0  # standard errors by which what is left exceeds nothing
LAGS = 12  # of a channel
LONGEST_LAG = 1.2  # s
SHAKEN_LAGS = 5  # of motion that shakes body and stick
HINGES = 6  # of a nonlinear map
PIECES = 9  # of a run
MEMORIES = (1.5, 6.0)  # s, of slow senses such as semicircular canals
LAGGED = 0.2  # s, by which an output of limited rate stays behind
REPEATS = "part of the residual repeats from run to run, or follows the target"


@dataclass(frozen=True)
class SearchNumbers:
    """Numbers of a search.

    ``steps`` are judged models with none, the first, the first two ... of the effects ``added``
    (names). ``ceiling``, known to ``ceiling_sd``, is NaN for the reason ``no_ceiling``. ``share``
    is the part of the output's power that is not its mean.
    """

    path: Path
    steps: list[SearchStep]
    added: list[str]
    left: list[Leftover]
    noises: list[tuple[Effect, Signature]]
    ceiling: float
    ceiling_sd: float
    no_ceiling: str
    share: float
    changes: dict[str, tuple[float, float, float]]

    @property
    def ids(self) -> list[str]:
        """Ids of what was found."""
        effects = dict(self.path.model.effects.steps)
        noises = [effect.name for effect, _ in self.noises]
        return [*(effects[name].name for name in self.added), *noises]

    @property
    def gained(self) -> float:
        """Points of VAF that the effects added gain on held-out rows."""
        return self.steps[-1].vaf - self.steps[0].vaf

    @property
    def worst(self) -> float:
        """Points of the largest structure that is left."""
        return max([item.points for item in self.left], default=0.0)

    @property
    def explainable_gap(self) -> float:
        return float(max(self.gained + self.worst, 0.0))


@dataclass(frozen=True)
class JudgedRecord:
    """The record that a path is judged on, where the search looked at another.

    It looked at some of the runs only, or at the output without a tremor. ``held`` is what each of
    its folds holds out of this record.
    """

    record: Record
    held: Sequence[Held]

    def refit_step(self, search: Search, step: SearchStep, model: Model) -> SearchStep:
        """A step with its model fitted to this record, judged by the folds of the search."""
        base, without = search.fitted_without_folds(model)
        prediction = self.prediction(base, without)
        at_likelihood = refit_on_all_runs(step.at_likelihood, self.record)
        vaf = vaf_of_output(self.record, prediction)
        return replace(step, at_likelihood=at_likelihood, vaf=vaf, prediction=prediction)

    def prediction(self, model: Model, without: Sequence[np.ndarray]) -> np.ndarray:
        """Free runs of a model, and in rows of each fold with the parameters of ``without``."""
        core, effects = model.simulator.core, model.effects
        found = Simulator(core, effects, self.record).run(model.theta)
        for theta, (columns, rows) in zip(without, self.held, strict=True):
            held_out = Simulator(core, effects, self.record.part(columns, 1)).run(theta)
            found[:, columns] = np.where(rows, held_out, found[:, columns])
        return np.where(np.isfinite(found), found, 0.0)


def measure_path(
    search: Search,
    path: Path,
    best: GreyBox,
    prepared: Prepared,
    measured: np.ndarray,
    recorded: np.ndarray,
    judged_on: JudgedRecord | None = None,
) -> SearchNumbers:
    """Walk the path again, and look for what is left in ``recorded``; ``measured`` is all of y."""
    record = replace(search.record, y=recorded)
    steps = walked(search, path, judged_on)
    left = leftovers(path.model, search.folds, search.loop)
    noises, others = noises_in(recorded - path.model.output, record, search.noises)
    left += [Leftover(s.where, "output", s.words, 100 * s.share, np.nan) for s in others]
    rest, rest_sd, vaf, unknown = find_gap(best, prepared, measured)
    noted = LEAST_GAIN * search.share
    left = [item for item in left if item.points >= noted]
    if rest > LEFT_SURELY * rest_sd and rest >= noted:  # not where it is NaN
        left.insert(0, Leftover("repeats", "output", REPEATS, rest, np.nan))
    ceiling, why = consistent_ceiling(vaf + rest, max(step.vaf for step in steps), rest_sd)
    if unknown:  # or only at least
        ceiling = np.nan
    return SearchNumbers(
        path=path,
        steps=steps,
        added=path.added,
        left=left,
        noises=noises,
        ceiling=ceiling,
        ceiling_sd=rest_sd,
        no_ceiling=unknown or str(why or ""),
        share=search.share,
        changes=further_changes(search, path),
    )


def walked(search: Search, path: Path, judged_on: JudgedRecord | None = None) -> list[SearchStep]:
    """Models with the first, the first two ... of the effects, each fitted anew for every fold."""
    models = search.partial_models(path.model, len(path.steps[0].at_likelihood.effects), path.core)
    steps = [search.judge_candidates(model, []) for model in models]
    if judged_on is not None:
        pairs = zip(steps, models, strict=True)
        return [judged_on.refit_step(search, step, model) for step, model in pairs]
    predictions = [search.refitted(model) for model in models]
    return [
        replace(step, vaf=vaf_of_output(search.record, prediction), prediction=prediction)
        for step, prediction in zip(steps, predictions, strict=True)
    ]


def find_gap(
    model: GreyBox, prepared: Prepared, measured: np.ndarray
) -> tuple[float, float, float, str]:
    """Explainable gap of a model (points), its standard error, its VAF, and why it is not known."""
    layout = prepared.grid.layout
    read = RunsRead(
        model=model,
        layout=layout,
        index=pd.RangeIndex(layout.n_rows),
        measured=measured,
        free_run=model.by_likelihood().free_run(prepared),
        trimmed=np.zeros(layout.n_rows, dtype=bool),
        columns=dict(zip(prepared.names, prepared.table.T, strict=True)),
        roles=model.get_params(deep=False).get("roles"),
        output="u",
        units={},
    )
    try:
        signals = prepare_signals(read, run_in=model.settling)
    except ValueError:
        return np.nan, np.nan, np.nan, "the runs are too short for spectra"
    found = noise_ceiling(signals)
    unknown = "" if found.route.separates and found.known else str(found.note)
    return found.gap, found.sd, found.vaf, unknown


@dataclass(frozen=True)
class Leftover:
    """Structure left in the residual, and where; of one of ``FAMILIES``, or of none ("")."""

    where: str
    at: str
    description: str
    points: float
    delta_bic: float
    family: str = ""


class _Probe(Effect):
    """One basis function in place of an effect."""

    name = "probe"
    place = "input"
    runs_apart = False  # it holds signals of all runs

    def __init__(self, place: str = "input", shape: object = None):
        self.place = place  # type: ignore[misc]
        self.shape = shape

    def apply(self, signal: object, record: Record) -> object:
        return self.shape(signal, record)  # type: ignore[operator]


# What responses are in the residual: where they show, and in words.
FAMILIES = {
    "map": ("amplitude", "the response depends on the size or the sign of the error"),
    "output size": ("amplitude", "the output departs from the model by its own size"),
    "output rate": ("amplitude", "the output departs from the model by its own rate"),
    "gains in time": ("time", "the gains change during the run"),
    "level in time": ("time", "the output has an offset that varies during the run"),
    "path": ("channel", "the output responds to {}"),
    "immediate path": ("channel", "the output follows {} without a delay"),
    "scheduled gains": ("channel", "the gains follow {}"),
    "dynamics": ("frequency", "the linear dynamics differ"),
}
IN_LOOP = ("channel", "frequency")  # where the remnant may be followed round the loop


def leftovers(
    model: Model, folds: Sequence[HeldOutRows], judge: LoopJudge | None = None
) -> list[Leftover]:
    """Families that explain part of a model's residual on held-out rows, best first.

    With a ``judge`` and a loop that can be solved, a family of ``IN_LOOP`` is credited with the
    least of its points: outside the loop, in it at the usual rate, and in it at 12.5 Hz. In the
    loop it cannot follow the remnant, and at the lower rate not the sensor's error.
    """
    found = _found(model, folds)
    if judge is not None and any(item.where in IN_LOOP for item in found):
        inside = judge.around(model).fit
        for rate in (None, RATES[0]):
            if not np.isfinite(inside.output).all():  # from where the last rate ended, too
                return sorted(found, key=lambda item: -item.points)
            asked = {(i.family, i.at) for i in found if i.where in IN_LOOP and i.points > 0}
            of_rate = _found(inside, judge.folds, rate, asked)
            points = {(i.family, i.at): i.points for i in of_rate}
            found = [
                replace(item, points=min(item.points, points.get((item.family, item.at), 0.0)))
                if item.where in IN_LOOP
                else item
                for item in found
            ]
    return sorted((item for item in found if item.points > 0), key=lambda item: -item.points)


def _found(
    model: Model,
    folds: Sequence[HeldOutRows],
    rate: float | None = None,
    asked: Container[tuple[str, str]] | None = None,
) -> list[Leftover]:
    """What families find, at a rate; only those ``asked`` for (family, at); None: all."""
    record = model.simulator.record
    criterion = Criterion(record, rate=rate)
    criterion.set_noise(criterion.remnant_model(model.output))
    base = model.refined(criterion, max_iter=4)
    own = derivatives(base.simulator, criterion, base.theta)
    found = []
    for family, at, computed in _families(base):
        if asked is not None and (family, at) not in asked:
            continue
        columns = computed()
        if not len(columns):
            continue
        thin = np.stack([c[:: criterion.thin] for c in columns]) * criterion.known
        columns.clear()  # before the next are computed
        result = _judge_columns(own, thin, criterion, folds)
        if result is not None:
            where, words = FAMILIES[family]
            found.append(Leftover(where, at, words.format(at), *result, family))
    return found


def _judge_columns(
    own: np.ndarray,
    columns: np.ndarray,
    criterion: Criterion,
    folds: Sequence[HeldOutRows],
) -> tuple[float, float] | None:
    """Points that columns gain on held-out rows beside a model's derivatives, and ΔBIC; or None."""
    n_own = len(own) - 1
    plain = np.concatenate([own[:-1], columns])
    residual = own[-1]
    white = criterion.whitened(np.concatenate([plain, residual[None]]))
    gram = white @ white.T
    n = criterion.n
    before = gram[-1, -1] - _explained(gram[:n_own, :n_own], gram[:n_own, -1])
    after = gram[-1, -1] - _explained(gram[:-1, :-1], gram[:-1, -1])
    least = 1e-300  # a model may be exact
    delta_bic = n * np.log(max(before, least) / max(after, least)) - len(columns) * np.log(n)
    if delta_bic < 2 * THRESHOLD:
        return None
    points = points_gained(white, plain, residual, n_own, criterion, folds, _solved)
    return (points, float(delta_bic)) if points > 0 else None


def points_gained(
    white: np.ndarray,
    plain: np.ndarray,
    residual: np.ndarray,
    n_own: int,
    criterion: Criterion,
    folds: Sequence[HeldOutRows],
    solved: Callable[[np.ndarray, np.ndarray], np.ndarray],
    known: np.ndarray | float = 0.0,
) -> float:
    """Points of held-out VAF that responses (``plain``, and ``white`` with the residual) gain."""
    by_row = white.reshape(len(white), *residual.shape)
    gained = total = 0.0
    for fold in folds:
        train, test = fold.train[:: criterion.thin], fold.test[:: criterion.thin]
        rows = by_row[:, train]
        g = rows @ rows.T
        full = solved(g[:-1, :-1] + known, g[:-1, -1])
        fewer = solved(g[:n_own, :n_own], g[:n_own, -1])
        left = residual[test]
        e0 = left - fewer @ plain[:n_own, test]
        e1 = left - full @ plain[:, test]
        # Own parameters that move beyond their linearisation would make any response look good.
        gained += min(float(e0 @ e0), float(left @ left)) - float(e1 @ e1)
        total += float((criterion.y[test] ** 2).sum())
    return 100 * gained / max(total, 1e-300)


def _solved(gram: np.ndarray, product: np.ndarray) -> np.ndarray:
    d = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / np.outer(d, d) + 1e-6 * np.eye(len(d))
    return np.linalg.solve(scaled, product / d) / d


def _explained(gram: np.ndarray, product: np.ndarray) -> float:
    return float(product @ _solved(gram, product))


def remembered(signal: np.ndarray, seconds: float, record: Record) -> np.ndarray:
    """A signal through a lag, of shape (n_samples, n_runs)."""
    keep = np.exp(-record.dt / (seconds * record.time_unit))
    return lfilter([1 - keep], [1, -keep], signal, axis=0)


def _more(gains: Gains, name: str, shape: np.ndarray) -> np.ndarray:
    return getattr(gains, name) * (1 + 0.05 * shape)


# A family, at what, and what computes the changes of the output that it could make.
Family = tuple[str, str, Callable[[], list[np.ndarray]]]


def _families(model: Model) -> Iterator[Family]:
    """Families one after the other: each takes the room of a dozen outputs, once computed."""
    simulator = model.simulator
    closed = simulator if isinstance(simulator, LoopSimulator) else None
    record = simulator.record if closed is None else closed.record_inside
    values = model.values()
    output = Simulator(simulator.core, model.effects, record).run(model.theta)

    def with_probe(place: str, shape: object, first: bool = True) -> np.ndarray:
        probe = ("probe", _Probe(place, shape))
        steps = [probe, *model.effects.steps] if first else [*model.effects.steps, probe]
        probed = Simulator(simulator.core, Effects(steps), record)
        change = probed.run(np.array([values[n] for n in probed.names])) - output
        return change if closed is None else closed.closed(change)

    def knots(signal: np.ndarray) -> np.ndarray:
        return np.quantile(signal[record.known], np.linspace(0.05, 0.95, HINGES))

    error = record.input
    yield (
        "map",
        record.inputs[0],
        lambda: [
            with_probe("input", lambda e, _, k=k: e + 0.1 * np.maximum(e - k, 0))
            for k in knots(error)
        ],
    )
    yield (
        "output size",
        "output",
        lambda: [np.maximum(output - k, 0) for k in knots(output)],
    )
    rate = differentiated(output, record.dt)
    yield (
        "output rate",
        "rate of the output",
        lambda: [remembered(np.maximum(rate - k, 0), LAGGED, record) for k in knots(rate)],
    )
    t = record.t
    ends = np.linspace(float(t.min()), float(t.max()), PIECES)
    width = ends[1] - ends[0]
    shapes = [np.clip(1 - np.abs(t - c) / width, 0, 1) for c in ends]
    yield (
        "gains in time",
        "gain",
        lambda: [
            with_probe("gain", lambda g, _, s=s, o=o: g._replace(**{o: _more(g, o, s)}))
            for o in ("error", "rate")
            for s in shapes
        ],
    )
    yield (
        "level in time",
        "level",
        lambda: [np.broadcast_to(s, output.shape).copy() for s in shapes],
    )
    for name in record.channels:
        if name not in record.inputs:
            yield from _families_of_channel(name, record, with_probe)
    yield (
        "dynamics",
        record.inputs[0],
        lambda: [
            with_probe("path", lambda c, r, s=s: c.plus(0.1 * r.delayed(error, s)), False)
            for s in record.time_unit * np.linspace(0.0, 2.0, LAGS)
        ],
    )


def _families_of_channel(
    name: str, record: Record, with_probe: Callable[..., np.ndarray]
) -> Iterator[Family]:
    channel = record.glance(name)
    lags = record.time_unit * np.linspace(0.06, LONGEST_LAG, LAGS)
    role = record.roles.get(name, "")
    centred = channel - channel[record.known].mean()
    # A channel that the loop moves could return the output itself without a delay.
    seconds = (
        lags if role in ("x", "") or role.startswith("motion") else lags - 0.5 * record.time_unit
    )
    yield (
        "path",
        name,
        lambda: [
            with_probe("path", lambda c, r, s=s, z=z: c.plus(0.1 * r.delayed(z, s)), False)
            for s, z in [
                *((s, centred) for s in seconds),
                *((seconds[1], remembered(centred, T, record)) for T in MEMORIES),
            ]
        ],
    )
    if shakes(name, record):
        yield (
            "immediate path",
            name,
            lambda: [
                with_probe("sum", lambda u, r, s=s: u + 0.1 * r.delayed(centred, s), False)
                for s in record.time_unit * np.linspace(0.0, 0.4, SHAKEN_LAGS)
            ],
        )
    if role == OTHER:
        size = np.tanh(
            centred / record.sd(name)
        )  # bounded: a run left out may go beyond the others
        yield (
            "scheduled gains",
            name,
            lambda: [
                with_probe("gain", lambda g, _, s=s, o=o: g._replace(**{o: _more(g, o, s)}))
                for s in (size, size * np.abs(size), size**2)
                for o in ("error", "rate")
            ],
        )
