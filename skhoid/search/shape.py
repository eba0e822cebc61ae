"""``Shape``: what a search shows of an effect that has no name, and the free form that fits it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects.catalogue import FREE_FORMS
from ..effects.composition import Effects
from ..effects.derived import DERIVED
from ..effects.free_form import FEWEST, FreeForm
from ..effects.free_forms import TIME, one_sided
from ..effects.record import Record
from ..effects.registry import titles_of
from ..model.estimator import GreyBox, vaf_of_output
from ..model.fitting import Criterion, RemnantModel, derivatives, scaled_inverse
from ..model.likelihood import TOLERATED, settled
from ..model.model import Model
from ..model.parameters import effects_with_values
from ..model.prepared import Prepared
from ..model.simulator import Simulator
from ..model.smoothing import (
    CROWDED,
    N_FINE,
    change_if_finer,
    change_if_rougher,
    crowded,
    find_posterior,
    refine_detail,
)
from ..model.uncertainty import estimate_covariance
from ..text import Document, Paragraph, TextTable, Told, number
from .data import refit_on_rows
from .formulas import Fitted, find_formula
from .judges import HeldOutRows, held_out, thin_rows
from .judging import FLOOR, LEAST_GAIN, THRESHOLD, Candidate, find_lead
from .leftover import Leftover, SearchNumbers, find_gap
from .likeness import acts_where, nearest_effects, nearest_table, recordings_for
from .path import CLAIM, tell_chances
from .statuses import Against, Ending, Reason, Verdict
from .steps import Search, SearchStep, output_error_fit

SHOWN = 3  # nearest names in a sentence
NEAR = 0.7  # distance of a curve that has half of the power in common
POINTS = 9  # of a curve in a table
MOST_KNOTS = 81  # of a curve
AXES = {  # what a curve is a function of, on an axis; others are names of channels
    "e": "error e",
    "u": "output u",
    "du/dt": "rate of u",
    "time": "time in the run",
} | {name: derived.short for name, derived in DERIVED.items()}
NAMES_AHEAD = "Nearest names, by distance (0: the same curve; 1: nothing in common)"
BY_HAND = 'search.sketch_effect("my_effect", "my_effect.py")'
FOLLOWED = 4  # forms whose curves are fitted to the end
SIZES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the prior, times the usual one
NAME = "free"
AS_GOOD = 0.05  # points, by which held-out rows hardly speak against more knots
APART = 3.0  # nats, odds of 20 to 1, by which forms are told apart
HOPEFUL = 0.5  # of what the effects found gain: at least what a form explains, linearised
MISFIT = 0.1  # share of what is explained, that a name may miss of its own form
N_POINTS = 101  # of a curve
N_DRAWS = 4000
LEVEL = 0.95  # of the band
AT_A_KINK = 3.0  # times the change by half the distance of knots; twice if nothing kept it back


@dataclass(frozen=True, eq=False, repr=False)
class Shape(Told):
    """An effect without a name: where it acts, its curve, and what it explains.

    Parameters
    ----------
    sentence : str
        Where it acts and what the curve is a function of, in words.
    curve : DataFrame
        Over the abscissa, in its unit: value, low and high of a simultaneous 95 % band, which
        contains the whole curve with that probability. Its linear part, where that is the gain, is
        left out.
    x_label, y_label : str
        Names and units of both axes.
    dof : float
        Effective degrees of freedom of the curve.
    gain : float
        Points of VAF on held-out rows, over the model without it.
    delta_bic : float
        Larger is better.
    closed : float
        Share of what the model without it leaves to explain.
    effect : FreeForm
        With the curve's values at its knots.
    name : str
        Of the effect in ``estimator``.
    estimator : estimator
        The model with the effects found and the shape, fitted to all rows.
    nearest : DataFrame
        Effects of the catalogue that act at the same place, nearest first, by id: title, form,
        distance (rms of the difference of both curves, relative to the curve's; 0 is the same, 1
        nothing in common), within_band, parameters.
    recordings : list of str
        What to record to tell them apart.
    nearest_curve : Series or None
        Of the nearest of them, over the abscissa; None where there is none.
    formula : Fitted or None
        A short formula that lies within the band, of what the effect adds; None where none does.
    family : str or None
        Id of the effect that acts at this place, if the data show it there and only its form fails.
    closest : list of str
        Ids of the effects of the catalogue that explain most of the same data.
    misses : float
        Share of what the shape explains that they miss.
    beside : list of str
        Ids of the other effects of ``estimator``.

    See Also
    --------
    EffectSearchCV : Its ``shape_`` is one, where something has no name.

    Examples
    --------
    A response to small errors that is weaker, in a search that knows no dead zone:

    >>> from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
    >>> from skhoid.effects import DeadZone
    >>> X, y = make_tracking_runs(
    ...     "C1",
    ...     n_runs=3,
    ...     remnant_intensity=0.1,
    ...     effects=DeadZone(width=0.6),
    ...     random_state=0,
    ... )
    >>> search = EffectSearchCV(OperatorRegressor(), effects=["bias"]).fit(X, y)
    >>> search.shape_.sentence
    'it acts on the gains, as a function of the size of the error'
    """

    sentence: str
    curve: pd.DataFrame
    x_label: str
    y_label: str
    dof: float
    gain: float
    delta_bic: float
    closed: float
    effect: FreeForm
    name: str
    estimator: Any = field(repr=False)
    nearest: pd.DataFrame = field(repr=False)
    recordings: list[str] = field(repr=False)
    nearest_curve: pd.Series | None = field(default=None, repr=False)
    formula: Fitted | None = field(default=None, repr=False)
    family: str | None = None
    closest: list[str] = field(default_factory=list)
    misses: float = float("nan")
    beside: list[str] = field(default_factory=list)

    @property
    def id(self) -> str:
        """Of the free form, such as ``"free_map"``."""
        return self.effect.name

    @property
    def place(self) -> str:
        """Where it acts, as ``Effect.place`` has it; ``"rate"`` for a map of the output's rate."""
        return "rate" if self.over == "du/dt" else self.effect.place

    @property
    def over(self) -> str:
        """What the curve is a function of: ``"e"``, ``"time"``, ``"lag"``, a channel ..."""
        return self.effect.over

    @property
    def channel(self) -> str | None:
        """The channel that it responds to, or that the curve is a function of, if there is one."""
        return getattr(self.effect, "channel", None)

    @property
    def explains(self) -> str:
        """Where it acts and how much it explains."""
        return (
            f"{self.sentence}; a curve with {self.dof:.1f} effective degrees of freedom raises "
            f"the held-out VAF by {self.gain:.1f} points, {100 * self.closed:.0f} % of what "
            f"{self._model_in_words} leaves to explain."
        )

    def sentences(self) -> list[str]:
        """What is known of it, without the curve.

        Returns
        -------
        sentences : list of str
            Where it acts and what it explains, the nearest names, a formula if one fits, what to
            record, and how to make it an effect of your own.
        """
        told = [f"The shape of what has no name: {self.explains}"]
        if self.family is not None:
            told.append(f"It acts where {titles_of([self.family])} does; only the form is another.")
        if self.closest:
            verb = "misses" if len(self.closest) == 1 else "miss"
            told.append(
                f"Of the catalogue, {titles_of(self.closest)} explain"
                f"{'s' if len(self.closest) == 1 else ''} most of the same, and {verb} "
                f"{self.misses:.0%} of it.".replace("%", " %")
            )
        if len(self.nearest):
            told.append(self._names())
        if self.formula is not None:
            told.append(self.formula.sentence)
        told += self.recordings
        told.append(f"To make it an effect of your own, in Python: {BY_HAND}.")
        return told

    @property
    def is_near(self) -> bool:
        """Whether an effect of the catalogue has more than half of the curve's power in common."""
        return bool((self.nearest["distance"] < NEAR).any())

    def _names(self) -> str:
        """The nearest effects of the catalogue in a sentence."""
        near = self.nearest[self.nearest["distance"] < NEAR].head(SHOWN)
        words = [
            f"{row['title']} (distance {row['distance']:.2f}"
            f"{', within the band' if row['within_band'] else ''})"
            for _, row in (near if len(near) else self.nearest.head(1)).iterrows()
        ]
        if near.empty:
            return f"No effect of the catalogue comes near its curve; the nearest is {words[0]}."
        return f"Nearest name{'s' if len(near) > 1 else ''}: {', '.join(words)}."

    @property
    def _model_in_words(self) -> str:
        """The model to which it was added, in words."""
        named = [name for name in self.beside if name != CLAIM]
        words = [titles_of(named)] if named else []
        if CLAIM in self.beside:  # estimated beside it: whether the given one is wrong is open
            words.append("a free delay")
        return f"the model with {' and '.join(words)}" if words else "the baseline"

    def document(self) -> Document:
        """All of it: sentences, the curve at a few points, and the effects that are nearest.

        Returns
        -------
        document : Document
        """
        first, *others = self.sentences()
        return Document(first, [*self.tables(), *map(Paragraph, others)])

    def tables(self) -> list[TextTable]:
        """The curve with its band at nine points, and the nearest effects, if there are any.

        Returns
        -------
        tables : list of TextTable
        """
        cells = []
        rows = np.linspace(0, len(self.curve) - 1, POINTS).round().astype(int)
        for at, row in self.curve.iloc[rows].iterrows():
            half = float(row["high"] - row["low"]) / 2
            value, low, high = (number(float(row[key]), half) for key in ("value", "low", "high"))
            cells.append([f"{float(str(at)):.3g}", value, f"{low} to {high}"])
        header = [self.x_label, self.y_label, "95 % band"]
        curve = TextTable("Curve of what has no name", header, cells, ("95 % band",), "shape")
        near = []
        for _, row in self.nearest.iterrows():
            called = row["title"] + (f" ({row['form']})" if row["form"] else "")
            within = "within" if row["within_band"] else "not within"
            near.append([called, f"{row['distance']:.2f}", within, row["parameters"]])
        header = ["effect", "distance", "band", "its numbers"]
        left = ("effect", "band", "its numbers")
        return [curve, TextTable(NAMES_AHEAD, header, near, left, "nearest")][: 1 + bool(near)]

    def plot(self, ax: Any = None) -> Any:
        """Draw the curve with its band.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.

        Returns
        -------
        display : EffectDisplay
        """
        from ..plotting import EffectDisplay

        return EffectDisplay.from_shape(self, ax=ax)

    def as_dict(self) -> dict[str, Any]:
        """The same as numbers and names, for JSON.

        Returns
        -------
        found : dict
        """
        told = ["id", "place", "over", "channel", "sentence", "x_label", "y_label"]
        told += ["dof", "gain", "delta_bic", "closed", "recordings"]
        told += ["family", "closest", "misses"]
        return {
            **{key: getattr(self, key) for key in told},
            "curve": self.curve.rename_axis("at").reset_index().to_dict("records"),
            "nearest": self.nearest.reset_index().to_dict("records"),
            "formula": self.formula
            and {"text": self.formula.formula.text, "numbers": self.formula.numbers},
        }

    def __repr__(self) -> str:
        return str(self.summary())


def make_labels(model: Model, name: str, units: dict[str, str | None]) -> tuple[str, str]:
    """Names and units of both axes."""
    effect: Any = dict(model.effects.steps)[name]
    first = next(p for p in model.simulator.parameters if p.name.startswith(f"{name}__"))
    x, y = effect.abscissa.label(units), first.dimension.label(units)
    over = AXES.get(effect.over, effect.over)
    if effect.over == "e" and model.simulator.record.domain == "machine":
        over = str(model.simulator.record.inputs[0])
    if first.behind:
        over += f" behind {' and '.join(first.behind)}"
    return _with_unit(over, x), _with_unit(effect.y_word, y)


def _with_unit(quantity: str, unit: str) -> str:
    """A quantity and its unit, where it has one that is known."""
    return quantity if unit == "-" or "[" in unit else f"{quantity}, {unit}"


def make_shape(
    candidate: Candidate, estimator: Any, closed: float, units: dict[str, str | None]
) -> Shape:
    """What a search shows of the best free form, in a fitted estimator that has it."""
    model = candidate.model
    assert model is not None
    effect: Any = dict(effects_with_values(model).steps)[candidate.name]
    curve, dof = curve_with_band(model, candidate.name)
    x_label, y_label = make_labels(model, candidate.name, units)
    values = model.values()
    gains = values.get("K_e", 1.0), values.get("K_edot", 0.0)
    record = replace(model.simulator.record, prediction=model.output)
    near = nearest_effects(effect, curve, record, units, gains)
    return Shape(
        sentence=effect.sentence_in(model.simulator.record.domain),
        curve=curve,
        x_label=x_label,
        y_label=y_label,
        dof=dof,
        gain=float(candidate.gain),
        delta_bic=float(candidate.delta_bic),
        closed=closed,
        effect=effect,
        name=candidate.name,
        estimator=estimator,
        nearest=nearest_table(near),
        recordings=recordings_for(effect, curve, near, effect.abscissa.label(units)),
        nearest_curve=pd.Series(near[0].curve, curve.index) if near else None,
        formula=find_formula(effect, curve, dof, record),
        beside=[one.name for own, one in model.effects if own != candidate.name],
    )


def detailed(search: Search, found: Candidate) -> Candidate:
    """The best form with knots enough for its details, unless held-out rows speak against them."""
    assert found.model is not None
    before = output_error_fit(found.model)

    def measure_vaf(model: Model) -> float:
        return vaf_of_output(search.record, held_out(model, search.criterion, search.folds))

    plain = before
    start = vaf = measure_vaf(before)
    while (few := _n_knots(plain, found.name) < N_FINE) or crowded(plain, found.name):
        least = max(N_FINE, 2 * _n_knots(plain, found.name) - 1)
        finer = refine_detail(plain, found.name, least) if least <= MOST_KNOTS else plain
        asked = -AS_GOOD if few else LEAST_GAIN * search.share
        if finer is plain or not (new := measure_vaf(finer)) - vaf > asked:
            break
        plain, vaf = finer, new
    if plain is before:
        return found
    more = vaf - start
    criterion = Criterion(search.record)
    criterion.set_noise(criterion.remnant_model(plain.output))
    model = plain.refined(criterion)
    effect = dict(model.effects.steps)[found.name]
    return replace(found, model=model, effect=effect, vaf=found.vaf + more, gain=found.gain + more)


def _n_knots(model: Model, name: str) -> int:
    return len(getattr(dict(model.effects.steps)[name], "knots", None) or ())


def _unbiased(fitted: Model, criterion: Criterion) -> tuple[Model, RemnantModel]:
    """A model and its noise model, estimated in turn, unless its free run gets much worse."""
    plain = Criterion(fitted.simulator.record)
    found, noise = settled(fitted, criterion)
    if plain.sse(found.output) <= TOLERATED * plain.sse(fitted.output):
        return found, noise
    criterion.set_noise(criterion.remnant_model(fitted.output))
    return fitted.under(criterion), criterion.noise


def fit_shape(
    ended: Unnamed, model: GreyBox, prepared: Prepared, measured: np.ndarray
) -> Shape | None:
    """The shape of a search on all rows; None where there is none."""
    if ended.form is None:
        return None
    found = detailed(ended.search, ended.form)
    assert found.model is not None
    fitted = refit_on_rows(prepared.record, output_error_fit(found.model))
    found_again = _unbiased(fitted, Criterion(prepared.record))
    best = model.with_fit(prepared, *found_again, fitted.theta)
    best.set_params(effects=found.model.effects)
    rest, _, _, _ = find_gap(best, prepared, measured)
    if not np.isfinite(rest):
        hints = find_hints(ended.search, output_error_fit(found.model))
        rest = max([hint.points for hint in hints if np.isfinite(hint.points)], default=0.0)
    closed = float(found.gain / max(found.gain + max(rest, 0.0), 1e-300))
    shape = make_shape(found, best, closed, prepared.units)
    closest, gain = ended.closest
    return replace(shape, family=ended.family, closest=closest, misses=float(1 - gain / found.gain))


@dataclass(frozen=True)
class Hint:
    """A form on probation: what its curves explain of a residual, linearised."""

    effect: FreeForm
    points: float
    delta_bic: float


def judge_forms(
    search: Search, parent: Model, forms: list[Candidate], named: Candidate | None = None
) -> SearchStep:
    """Free forms judged as effects with names are; those far from linear are refitted by fold.

    What trails the effects ``named`` cannot lead them, so no further judge is asked.
    """
    beside = [] if named is None or not forms else [named]
    step = search.weigh_candidates(parent, [*forms, *beside])
    far = [one for one in forms if one.model is not None and is_far(one.effect, search.record)]
    for one in forms:
        if named is not None and one not in far and trails(one, named):
            one.refused = Against(Reason.RIVAL, "the effects found explain the same, and more")
    if not beside or any(one.passes for one in forms):
        step.rank()
    for one in far:
        assert one.model is not None
        one.gain = search.refit(one.model) - max(step.vaf, step.refitted_vaf)
        one.refit = True
    if far:
        step.rank()
    return step


def trails(one: Candidate, other: Candidate) -> bool:
    """Whether a candidate has less for it than another: on held-out rows, and by the free run.

    Where folds are refitted their gains move, but by less than the share ``MISFIT``.
    """
    return one.gain < (1 - MISFIT) * other.gain and find_lead(one, other) < -APART


def is_far(form: Any, record: Record) -> bool:
    """Whether a form begins far from what is linear."""
    return any(form.starts(record)[0].values())


def list_candidates(search: Search, parent: Model, hints: Sequence[Hint]) -> list[Candidate]:
    """Free forms, fitted beside a parent."""
    candidates = []
    for which, hint in enumerate(hints):
        name = f"{NAME}_{which}"
        candidates.append(search.candidate(parent, name, hint.effect))
    return candidates


def find_hints(search: Search, parent: Model) -> list[Hint]:
    """Forms at every place where they apply, those first that explain most, and the likeliest."""
    if search.is_over:
        return []
    record = replace(search.record, prediction=parent.output)
    thinned, folds = thin_rows(search.record, search.folds)
    parent = Model(parent.simulator.beside(thinned), parent.fit)
    criterion = Criterion(thinned)
    criterion.set_noise(criterion.remnant_model(parent.output))
    own, values = derivatives(parent.simulator, criterion, parent.theta), parent.values()
    found = []
    for form in (form() for form in FREE_FORMS):
        if form.refusal_in(record, search.core.kind):
            continue
        for one in form.alternatives(record):
            for variant in one.variants(record):
                if len(variant.knots) < FEWEST:
                    continue  # what does not move has no curve
                if is_far(variant, record):
                    if one_sided(record):
                        found.append(Hint(variant, np.inf, np.inf))
                    continue
                effects = Effects([*parent.effects.steps, (NAME, variant)])
                simulator = Simulator(search.core, effects, search.record).beside(thinned)
                theta = np.array([values.get(name, 0.0) for name in simulator.names])
                at = [i for i, name in enumerate(simulator.names) if name not in values]
                columns = derivatives(simulator, criterion, theta, at)[:-1]
                prior = simulator.prior.normal_equations(theta)[0][np.ix_(at, at)]
                result = hinted(own, columns, prior, criterion, folds)
                if result is not None:
                    found.append(Hint(variant, *result))
                search.record.forget()  # one channel after the other
                thinned.forget()
    found = likeliest_of_each(found)
    most = max([hint.points for hint in found if np.isfinite(hint.points)], default=0.0)

    def order(hint: Hint) -> tuple[float, float]:
        near = most - AS_GOOD < hint.points < np.inf
        return -(most if near else hint.points), -hint.delta_bic

    return sorted(found, key=order)


def likeliest_of_each(hints: Sequence[Hint]) -> list[Hint]:
    """Of forms over the same at the same place, odd or not, ahead or not, the likeliest."""
    best: dict[tuple, Hint] = {}
    for hint in sorted(hints, key=lambda one: one.delta_bic):
        form: Any = hint.effect
        best[form.name, form.place, form.over, getattr(form, "channel", None)] = hint
    return list(best.values())


def hinted(
    own: np.ndarray,
    columns: np.ndarray,
    prior: np.ndarray,
    criterion: Criterion,
    folds: Sequence[HeldOutRows],
) -> tuple[float, float] | None:
    """Points that curves gain on held-out rows beside a model's derivatives, and ΔBIC; or None."""
    n_own, n = len(own) - 1, criterion.n
    plain = np.concatenate([own[:-1], columns])
    residual = own[-1]
    white = criterion.whitened(np.concatenate([plain, residual[None]]))
    gram = white @ white.T
    before = gram[-1, -1] - gram[:n_own, -1] @ _solve(gram[:n_own, :n_own], gram[:n_own, -1])
    known = np.zeros_like(gram[:-1, :-1])
    best: tuple[float, np.ndarray] = (-np.inf, known)
    for size in SIZES:
        known = known.copy()
        known[n_own:, n_own:] = before / n * prior / size**2
        inverse = scaled_inverse(gram[:-1, :-1] + known)
        theta = inverse @ gram[:-1, -1]
        after = gram[-1, -1] - 2 * theta @ gram[:-1, -1] + theta @ gram[:-1, :-1] @ theta
        dof = np.trace(inverse @ gram[:-1, :-1]) - n_own
        delta_bic = n * np.log(max(before, 1e-300) / max(after, 1e-300)) - dof * np.log(n)
        best = max(best, (float(delta_bic), known), key=lambda one: one[0])
    delta_bic, known = best
    if delta_bic < 2 * THRESHOLD:
        return None
    by_row = white.reshape(len(white), *residual.shape)
    gained = total = 0.0
    for fold in folds:
        train, test = fold.train[:: criterion.thin], fold.test[:: criterion.thin]
        rows = by_row[:, train]
        gram = rows @ rows.T
        left, fewer = residual[test], _solve(gram[:n_own, :n_own], gram[:n_own, -1])
        without = left - fewer @ plain[:n_own, test]
        beside = left - _solve(gram[:-1, :-1] + known, gram[:-1, -1]) @ plain[:, test]
        # Own parameters that move beyond their linearisation would make any response look good.
        gained += min(float(without @ without), float(left @ left)) - float(beside @ beside)
        total += float((criterion.y[test] ** 2).sum())
    return (100 * gained / max(total, 1e-300), delta_bic) if gained > 0 else None


def _solve(gram: np.ndarray, product: np.ndarray) -> np.ndarray:
    return np.asarray(scaled_inverse(gram) @ product)


@dataclass(frozen=True)
class Unnamed:
    """Numbers and verdict of a search, and the form of what has no name.

    ``family`` is the id of the effect that acts where the form does and whose own form fails.
    """

    found: SearchNumbers
    ending: Ending
    search: Search
    form: Candidate | None = None
    family: str | None = None

    @property
    def closest(self) -> tuple[list[str], float]:
        """Ids of the effects that the form replaces, or of that which explains most; their gain."""
        if self.ending.stand_ins:
            return self.ending.stand_ins, self.found.gained
        tried = [c for c in self.found.path.steps[-1].candidates if np.isfinite(c.gain)]
        best = max(tried, key=lambda c: c.gain, default=None)
        return ([], 0.0) if best is None else ([best.effect.name], max(best.gain, 0.0))


def find_unnamed(search: Search, found: SearchNumbers, *, tries_all: bool) -> Unnamed:
    """The verdict: the effects found, unless a free form explains them better, and what is left.

    Free forms at all places are the rivals of the effects found, beside the same baseline and by
    the same judges. The best of them decides where something acts; the name of an effect that acts
    there stands, unless its form misses more than ``MISFIT`` of what the free one explains.
    """
    unknown = Verdict.beyond(tries_all)
    if found.path.steps[-1].best is not None:
        unknown = Verdict.CUT_SHORT
    ids = found.ids
    named = named_candidate(found)
    step = judge_rivals(search, found, named)
    rival = find_rival(search, step, found, named)
    tell_chances(found.path, rival.lead, found.left_nats)
    if rival.wins is not None:
        found = with_forms(found, step, named)
        return Unnamed(found, Ending(unknown, [], ids), search, rival.wins, rival.family)
    beside = None
    if named is not None:
        step = judge_beside(search, found)
        beside = find_best(search, step)
    found = with_forms(found, step)
    if beside is not None and counts(beside.gain, found):
        return Unnamed(found, Ending(unknown, ids, []), search, beside)
    unseen = [item.points for item in found.left if item.where in ("repeats", "curved")]
    if counts(max(unseen, default=0.0), found):
        return Unnamed(found, Ending(unknown, ids, []), search)
    return Unnamed(found, Ending(Verdict.FOUND if ids else Verdict.NOTHING, ids, []), search)


def with_forms(
    found: SearchNumbers, step: SearchStep, named: Candidate | None = None
) -> SearchNumbers:
    """Numbers with what free forms that were judged explain more than the effects ``named``."""
    record = step.at_least_error.simulator.record
    gained, granted = (0.0, 0.0) if named is None else (named.gain, named.delta_bic)
    left = list(found.left)
    for one in step.candidates:
        if one is not named and one.passes and one.refit:
            form: Any = one.effect
            told = *locate_form(form, record), form.sentence_in(record.domain)
            left.append(Leftover(*told, one.gain - gained, one.delta_bic - granted))
    least = LEAST_GAIN * found.share
    return replace(found, left=[item for item in left if item.points >= least])


def locate_form(form: FreeForm, record: Record) -> tuple[str, str]:
    """Where a form acts, and at what, as ``unexplained_`` has it."""
    channel = getattr(form, "channel", None)
    if channel in record.channels:
        return "channel", str(channel)
    if form.over == TIME:
        return "time", form.place
    if form.over == "lag":
        return "frequency", record.inputs[0]
    return "amplitude", record.inputs[0] if form.over == "e" else form.over


def counts(points: float, found: SearchNumbers) -> bool:
    """Whether so many points are more than what a model of nearly the right form leaves."""
    return points >= max(FLOOR * found.share, MISFIT * (points + found.gained))


class Rival(NamedTuple):
    """By how many nats a form leads the effects found, or nothing.

    A form at the place of the first of them leads only if that one's own form fails.

    ``wins`` is the form that explains the data better than they do, if one does, and ``family`` the
    effect at its place.
    """

    wins: Candidate | None = None
    family: str | None = None
    lead: float = -np.inf


def judge_rivals(search: Search, found: SearchNumbers, named: Candidate | None) -> SearchStep:
    """The effects found, and the forms that explain most of the same, beside the baseline."""
    baseline = found.steps[0].at_least_error
    least = HOPEFUL * max(found.gained, LEAST_GAIN * found.share)  # less is never told
    hints = [hint for hint in find_hints(search, baseline) if hint.points > least]
    tried = hints[:FOLLOWED]
    if named is not None:
        there = [hint for hint in hints if acts_like(hint.effect, named, baseline)][:1]
        tried += [hint for hint in there if hint not in tried]
    forms = list_candidates(search, baseline, tried)
    return judge_forms(search, baseline, forms, named)


def find_rival(
    search: Search, step: SearchStep, found: SearchNumbers, named: Candidate | None
) -> Rival:
    """The form that rivals the effects found."""
    best = find_best(search, step, named)
    if best is None or not counts(best.gain, found):
        return Rival()
    if named is None:
        return Rival(best, None, best.least)
    judge_refitted(search, step, named)
    by = lead(best, named)
    own = [
        one
        for one in step.candidates
        if by > 0.0 and one is not named and acts_like(one.effect, named, step.at_least_error)
    ]
    for one in own[:1]:
        judge_refitted(search, step, one)
        elsewhere = lead(best, one)
        fails = one.gain - named.gain > MISFIT * one.gain
        if fails and elsewhere <= THRESHOLD < by:
            return Rival(one, named.effect.name, by)
        by = min(by, elsewhere)  # of what is as good at the same place the name is one
    return Rival(best if by > THRESHOLD else None, None, by)


def find_best(search: Search, step: SearchStep, named: Candidate | None = None) -> Candidate | None:
    """The form that passes and leads; of those not told apart the first of the catalogue."""
    order = [form.name for form in FREE_FORMS]
    near: list[Candidate] = []
    for one in [one for one in step.candidates if one is not named and one.passes]:
        if near and find_lead(near[0], one) > APART:
            continue
        judge_refitted(search, step, one)
        if one.passes and (not near or lead(near[0], one) <= APART):
            near.append(one)
    return min(near, key=lambda one: order.index(one.effect.name), default=None)


def judge_refitted(search: Search, step: SearchStep, one: Candidate) -> None:
    """Judge a candidate by all that can, with what it gains where folds are refitted."""
    assert one.model is not None
    step.judge(one)
    if not one.refit:
        step.refit_gain(one)


def lead(one: Candidate, other: Candidate) -> float:
    """Nats by which one candidate leads another, if it explains more of held-out rows."""
    return find_lead(one, other) if one.gain > other.gain else -np.inf


def named_candidate(found: SearchNumbers) -> Candidate | None:
    """All effects found as one candidate beside the baseline, under the name of the first."""
    if not found.added:
        return None
    model = output_error_fit(found.path.model)
    first = found.added[0]
    return Candidate(first, dict(model.effects.steps)[first], model=model)


def acts_like(form: FreeForm, named: Candidate, baseline: Model) -> bool:
    """Whether the first of the effects found acts where a form does."""
    model = named.model
    assert model is not None
    effect = dict(model.effects.steps)[named.name]
    values = model.values()
    own = {p.name: values[f"{named.name}__{p.name}"] for p in effect.free}
    gains = values.get("K_e", 1.0), values.get("K_edot", 0.0)
    record = replace(model.simulator.record, prediction=baseline.output)
    return acts_where(form, effect, own, record, gains)


def judge_beside(search: Search, found: SearchNumbers) -> SearchStep:
    """The forms that explain most of what the effects found leave, if that counts."""
    parent = output_error_fit(found.path.model)
    tried = [hint for hint in find_hints(search, parent)[:FOLLOWED] if counts(hint.points, found)]
    return judge_forms(search, parent, list_candidates(search, parent, tried))


def curve_with_band(model: Model, name: str) -> tuple[pd.DataFrame, float]:
    """Curve of a free form of a model with a simultaneous band, and its degrees of freedom.

    ``model`` is at the largest likelihood. The band is that of the posterior, enlarged so that it
    holds the whole curve: Ruppert, Wand and Carroll, Semiparametric regression (2003), section 6.5.
    The posterior has what parameters have too: a remnant that is not quite the noise model's, and
    the accuracy of the simulation. More is added at each point: what smoothing may have taken from
    a bend that is sharper than the rest, which is how far the curve moves where it may be much
    rougher; how far it moves on rows at half the rate; and, where the data use most coefficients,
    what few knots miss at a kink, by what further ones half-way between would change.
    """
    effect: Any = dict(model.effects.steps)[name]
    simulator = model.simulator
    criterion = Criterion(simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    own = [i for i, n in enumerate(simulator.names) if n.startswith(f"{name}__")]
    first, last = effect.ends
    if effect.over == TIME:  # before rows count, nothing tells it
        record = simulator.record
        first = max(first, float(record.t[record.known.any(axis=1)].min()))
    at = np.linspace(first, last, N_POINTS)
    design = effect.design(at)
    value = effect.at_rest + design @ model.theta[own]
    covariance = estimate_covariance(simulator, criterion, model.fit, simulator.prior)
    half = half_width(design, np.nan_to_num(covariance)[np.ix_(own, own)])
    rougher = design @ change_if_rougher(model, name, criterion)[own]
    half = half + np.abs(rougher) + np.abs(design @ change_if_slower(model)[own])
    dof = float(find_posterior(model, criterion).dof[own].sum())
    finer = effect.with_more_knots()
    if dof > CROWDED * len(own) and finer.knots != effect.knots:
        missed = change_if_finer(model, name, criterion, finer, at) - rougher
        half = half + AT_A_KINK * np.abs(missed)
    shown = {"value": value, "low": value - half, "high": value + half}
    curve = pd.DataFrame(shown, index=pd.Index(at, name=effect.over)).clip(lower=effect.least)
    return curve, dof


def half_width(design: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Half the width of a band that holds a whole curve of normal coefficients."""
    sd = np.sqrt(np.einsum("ij,jk,ik->i", design, covariance, design))
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal(np.zeros(len(covariance)), covariance, N_DRAWS, method="eigh")
    widest = np.abs(draws @ design.T / np.maximum(sd, 1e-300)).max(axis=1)
    return np.asarray(float(np.quantile(widest, LEVEL)) * sd)


def change_if_slower(model: Model) -> np.ndarray:
    """Change of the parameters on rows at half the rate of the criterion."""
    record = model.simulator.record
    criterion = Criterion(record, rate=record.criterion_rate / 2)
    criterion.set_noise(criterion.remnant_model(model.output))
    return model.refined(criterion, max_iter=4).theta - model.theta
