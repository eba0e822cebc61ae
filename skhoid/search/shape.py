"""``Shape``: what a search shows of an effect that has no name, and the free form that fits it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..effects.base import Effect
from ..effects.catalogue import FREE_FORMS
from ..effects.composition import Effects
from ..effects.free_form import FEWEST, FreeForm
from ..effects.free_forms import TIME, one_sided
from ..effects.record import Record
from ..effects.registry import titles_of
from ..model.estimator import GreyBox, vaf_of_output
from ..model.extend import extended
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
from .judges import HeldOutRows, held_out
from .judging import LEAST_GAIN, THRESHOLD, Candidate
from .leftover import Leftover, SearchNumbers, find_gap, leftovers, points_gained
from .likeness import nearest_effects, nearest_table, recordings_for
from .path import CLAIM, find_cost
from .statuses import Ending, Verdict
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
}
NAMES_AHEAD = "Nearest names, by distance (0: the same curve; 1: nothing in common)"
BY_HAND = 'search.sketch_effect("my_effect", "my_effect.py")'
FOLLOWED = 4  # forms whose curves are fitted to the end
SIZES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the prior, times the usual one
NAME = "free"
HOPEFUL = 0.5  # times what the effects found gain: at least what a form explains, linearised
TRIED = 3  # forms that are fitted in place of effects with names
ONE_FORM = "one free form explains more than all the effects named"
N_POINTS = 101  # of a curve
N_DRAWS = 4000
LEVEL = 0.95  # of the band
AT_A_KINK = 3.0  # times the change by half the distance of knots; twice if nothing kept it back


AS_GOOD = 0.05


class LeftBeside(NamedTuple):
    """How much structure may be left beside effects that are named.

    It counts as structure that nothing explains if it is at least ``points`` (of VAF about the
    mean) and more than the share ``counts`` of what could be explained. Names are dropped if it is
    more than the share ``unnames`` too; the limit rises with what the effects gain, to
    ``unnames_much`` for 10 points, since hardly anything else imitates as much.
    """

    points: float
    counts: float
    unnames: float
    unnames_much: float


BESIDE_ONE = LeftBeside(points=0.6, counts=0.1, unnames=0.12, unnames_much=0.5)
BESIDE_SEVERAL = LeftBeside(points=0.4, counts=0.04, unnames=0.04, unnames_much=0.25)
MUCH_GAINED = 10.0  # points about the mean, for which the last share holds
AS_GOOD_FORM = 0.1  # points
BEHIND, LINEAR = "behind the muscles' delay", "linear"
# A linear answer may be a delay, dynamics or a path, and a path may answer the size of the error.
GROUPS = {
    "delay": frozenset({LINEAR}),
    "path": frozenset({LINEAR, "input"}),
    "command": frozenset({LINEAR, BEHIND}),
    "spring": frozenset({BEHIND}),
    "output": frozenset({BEHIND}),
    "inside": frozenset({BEHIND}),
}


def decided(found: SearchNumbers, *, tries_all: bool) -> Ending:
    """Whether what was found can be named, and whether something else is missing."""
    ids, stand_ins, worst = found.ids, [], found.worst
    share = worst / max(worst + found.gained, 1e-300)
    limits = BESIDE_SEVERAL if len(found.added) > 1 else BESIDE_ONE
    large = largest_left(limits, found.gained, found)
    left = worst >= limits.points * found.share and share > limits.counts
    if not (left or found.one_cause):
        return Ending(Verdict.FOUND if ids else Verdict.NOTHING, ids, [])
    if found.one_cause:
        ids, stand_ins = [], ids
    elif share > large:
        kept = 1 if len(found.added) > 1 and first_explains(found) else 0
        ids, stand_ins = ids[:kept], ids[kept:]
    if found.path.steps[-1].best is not None:
        return Ending(Verdict.CUT_SHORT, ids, stand_ins)
    return Ending(unnamed_verdict(tries_all), ids, stand_ins)


def unnamed_verdict(tries_all: bool) -> Verdict:
    """The verdict of a search that leaves something without a name."""
    return Verdict.NOT_IN_CATALOGUE if tries_all else Verdict.NOT_TRIED


def first_explains(found: SearchNumbers) -> bool:
    """Whether the first effect would stay named on its own: later ones take nothing from it."""
    gained = found.steps[1].vaf - found.steps[0].vaf
    left = found.worst + found.gained - gained
    return left <= largest_left(BESIDE_ONE, gained, found) * (left + gained)


def largest_left(limits: LeftBeside, gained: float, found: SearchNumbers) -> float:
    """Share of what could be explained that may be left when a named effect gains so much."""
    return max(limits.unnames, limits.unnames_much * min(gained / (MUCH_GAINED * found.share), 1.0))


def first_stands(rival: Candidate, found: SearchNumbers) -> bool:
    """Whether the first effect acts where a form does, and leaves little of what that explains."""
    first = dict(found.path.model.effects.steps)[found.added[0]]
    left = rival.gain - (found.steps[1].vaf - found.steps[0].vaf)
    return (
        bool(find_group(rival.effect) & find_group(first))
        and left <= BESIDE_ONE.counts * rival.gain
    )


def excess_asked(one: Candidate, found: SearchNumbers) -> float:
    """Points by which a form must exceed all effects found to speak against them."""
    if len(found.added) > 1:
        return -AS_GOOD_FORM
    if not elsewhere(one.effect, found):
        return found.share * BESIDE_ONE.points
    named, form = found.path.model, one.model
    plainer = form is not None and form.n_parameters < named.n_parameters
    return -AS_GOOD_FORM if plainer else found.share * LEAST_GAIN


def elsewhere(form: Any, found: SearchNumbers) -> bool:
    """Whether a form acts elsewhere than all effects that were found."""
    effects = dict(found.path.model.effects.steps)
    own = find_group(form)
    return all(not own & find_group(effects[name]) for name in found.added)


def find_group(effect: Effect) -> frozenset[str]:
    """What an effect changes, so far as data tell places apart."""
    return GROUPS.get(effect.place, frozenset({effect.place}))


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
    gain_loop : float
        The same in the closed loop; NaN where that is not known.
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
    'it acts on the error, as a function of its size and sign'
    """

    sentence: str
    curve: pd.DataFrame
    x_label: str
    y_label: str
    dof: float
    gain: float
    gain_loop: float
    delta_bic: float
    closed: float
    effect: FreeForm
    name: str
    estimator: Any = field(repr=False)
    nearest: pd.DataFrame = field(repr=False)
    recordings: list[str] = field(repr=False)
    nearest_curve: pd.Series | None = field(default=None, repr=False)
    formula: Fitted | None = field(default=None, repr=False)

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
        loop = ""
        if np.isfinite(self.gain_loop):
            loop = f" (in the closed loop by {self.gain_loop:.1f})"
        return (
            f"{self.sentence}; a curve with {self.dof:.1f} effective degrees of freedom raises "
            f"the held-out VAF by {self.gain:.1f} points{loop}, {100 * self.closed:.0f} % of what "
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
        others = [effect.name for own, effect in self.estimator.effects_ if own != self.name]
        named = [name for name in others if name != CLAIM]
        words = [titles_of(named)] if named else []
        if CLAIM in others:  # estimated beside the shape: whether the given one is wrong is open
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
        told += ["dof", "gain", "gain_loop", "delta_bic", "closed", "recordings"]
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
    loop = candidate.in_loop
    return Shape(
        sentence=effect.sentence_in(model.simulator.record.domain),
        curve=curve,
        x_label=x_label,
        y_label=y_label,
        dof=dof,
        gain=float(candidate.gain),
        gain_loop=float("nan") if loop is None else float(loop.gain),
        delta_bic=float(candidate.delta_bic),
        closed=closed,
        effect=effect,
        name=candidate.name,
        estimator=estimator,
        nearest=nearest_table(near),
        recordings=recordings_for(effect, curve, near, effect.abscissa.label(units)),
        nearest_curve=pd.Series(near[0].curve, curve.index) if near else None,
        formula=find_formula(effect, curve, dof, record),
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


def fit_shape(
    unnamed_part: Unnamed, model: GreyBox, prepared: Prepared, measured: np.ndarray
) -> Shape | None:
    """The shape of a search on all rows; None where there is none.

    A form that the loop alone speaks against is the shape where it explains most of what repeats
    from run to run: to that the loop may be blind, and no remnant repeats.
    """
    if unnamed_part.form is not None:
        return _fit_form(unnamed_part, unnamed_part.form, model, prepared, measured)
    repeated = max([i.points for i in unnamed_part.found.left if i.where == "repeats"], default=0.0)
    for one in unnamed_part.doubtful if repeated else ():
        shape = _fit_form(unnamed_part, one, model, prepared, measured)
        if shape is not None and find_gap(shape.estimator, prepared, measured)[0] < repeated / 2:
            return shape
    return None


def _unbiased(fitted: Model, criterion: Criterion) -> tuple[Model, RemnantModel]:
    """A model and its noise model, estimated in turn, unless its free run gets much worse."""
    plain = Criterion(fitted.simulator.record)
    found, noise = settled(fitted, criterion)
    if plain.sse(found.output) <= TOLERATED * plain.sse(fitted.output):
        return found, noise
    criterion.set_noise(criterion.remnant_model(fitted.output))
    return fitted.under(criterion), criterion.noise


def _fit_form(
    unnamed_part: Unnamed,
    found: Candidate,
    model: GreyBox,
    prepared: Prepared,
    measured: np.ndarray,
) -> Shape | None:
    """The shape of one candidate."""
    if found.model is None:
        return None
    found = detailed(unnamed_part.search, found)
    assert found.model is not None
    fitted = refit_on_rows(prepared.record, output_error_fit(found.model))
    best = model.with_fit(prepared, *_unbiased(fitted, Criterion(prepared.record)))
    best.set_params(effects=found.model.effects)
    rest, _, _, _ = find_gap(best, prepared, measured)
    if not np.isfinite(rest):
        folds = unnamed_part.search.folds
        rest = max([item.points for item in leftovers(fitted, folds)], default=0.0)
    closed = float(found.gain / max(found.gain + max(rest, 0.0), 1e-300))
    return make_shape(found, best, closed, prepared.units)


@dataclass(frozen=True)
class Hint:
    """A form on probation: what its curves explain of a residual, linearised."""

    effect: FreeForm
    points: float
    delta_bic: float


def judge_forms(search: Search, parent: Model, forms: list[Candidate]) -> SearchStep:
    """Free forms judged as effects with names are; those far from linear are refitted by fold."""
    step = search.judge_candidates(parent, forms)
    far = [one for one in forms if one.model is not None and is_far(one.effect, search.record)]
    for one in far:
        assert one.model is not None
        one.vaf = search.refit(one.model)
        one.gain = one.vaf - max(step.vaf, step.refitted_vaf)
    if far:
        step.rank()
    return step


def is_far(form: Any, record: Record) -> bool:
    """Whether a form begins far from what is linear."""
    return any(form.starts(record)[0].values())


def list_candidates(
    search: Search, parent: Model, hints: Sequence[Hint], first: int = 0
) -> list[Candidate]:
    """Free forms, fitted beside a parent; the ``first`` of their numbers."""
    candidates = []
    for which, hint in enumerate(hints, first):
        name = f"{NAME}_{which}"
        model = extended(parent, name, hint.effect, search.criterion, search.coarse)
        candidates.append(Candidate(name, dict(model.effects.steps)[name], model=model))
    return candidates


def find_best_minima(search: Search, step: SearchStep) -> Candidate | None:
    """The best form, with what it gains where folds are refitted, as it is told of names."""
    best = step.best
    if best is None or best.model is None:
        return None
    vaf = search.refit(best.model)
    return replace(best, vaf=vaf, gain=vaf - step.refitted_vaf)


def find_hints(search: Search, parent: Model) -> list[Hint]:
    """Forms at every place where they apply, those first that explain most, and the likeliest."""
    record = replace(search.record, prediction=parent.output)
    criterion = Criterion(search.record)
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
                simulator = Simulator(search.core, effects, search.record)
                theta = np.array([values.get(name, 0.0) for name in simulator.names])
                at = [i for i, name in enumerate(simulator.names) if name not in values]
                columns = derivatives(simulator, criterion, theta, at)[:-1]
                prior = simulator.prior.normal_equations(theta)[0][np.ix_(at, at)]
                result = hinted(own, columns, prior, criterion, search.folds)
                if result is not None:
                    found.append(Hint(variant, *result))
                search.record.forget()  # one channel after the other
    most = max([hint.points for hint in found if np.isfinite(hint.points)], default=0.0)

    def order(hint: Hint) -> tuple[float, float]:
        near = most - AS_GOOD_FORM < hint.points < np.inf
        return -(most if near else hint.points), -hint.delta_bic

    return sorted(found, key=order)


def hinted(
    own: np.ndarray,
    columns: np.ndarray,
    prior: np.ndarray,
    criterion: Criterion,
    folds: Sequence[HeldOutRows],
) -> tuple[float, float] | None:
    """Points that curves gain on held-out rows beside a model's derivatives, and ΔBIC; or None."""
    n_own = len(own) - 1
    plain = np.concatenate([own[:-1], columns])
    residual = own[-1]
    white = criterion.whitened(np.concatenate([plain, residual[None]]))
    gram = white @ white.T
    n = criterion.n
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
    points = points_gained(white, plain, residual, n_own, criterion, folds, _solve, known)
    return (points, delta_bic) if points > 0 else None


def _solve(gram: np.ndarray, product: np.ndarray) -> np.ndarray:
    return np.asarray(scaled_inverse(gram) @ product)


@dataclass(frozen=True)
class Unnamed:
    """Numbers and verdict of a search, and the form of what has no name, or forms in doubt."""

    search: Search
    found: SearchNumbers
    ending: Ending
    form: Candidate | None = None
    doubtful: tuple[Candidate, ...] = ()


def find_unnamed(search: Search, found: SearchNumbers, *, tries_all: bool) -> Unnamed:
    """The verdict, with the shape of what has no name."""
    ending, baseline = decided(found, tries_all=tries_all), found.steps[0].at_least_error
    rival, hints = None, None
    if found.added:
        hints = find_hints(search, baseline)
        found, rival = beside_one_form(search, found, hints)
        ending = decided(found, tries_all=tries_all)
    elif ending.verdict is Verdict.NOTHING and (found.left or one_sided(search.record)):
        hints = find_hints(search, baseline)[:FOLLOWED]
        forms = list_candidates(search, baseline, hints)
        shape = find_best_minima(search, judge_forms(search, baseline, forms))
        if shape is None or shape.gain < BESIDE_ONE.points * found.share:
            return Unnamed(search, found, ending)
        return Unnamed(search, found, Ending(unnamed_verdict(tries_all), [], []), shape)
    if not ending.verdict.leaves_unknown:
        return Unnamed(search, found, ending)
    parent = unnamed_parent(found, ending)
    if rival is None or parent is not baseline:
        if hints is None or parent is not baseline:
            hints = find_hints(search, parent)
        forms = list_candidates(search, parent, hints[:FOLLOWED])
        step = judge_forms(search, parent, forms)
        rival = find_best_minima(search, step)
        if rival is None:
            doubtful = [c for c in step.candidates if c.refused is None and c.joint > 2 * THRESHOLD]
            return Unnamed(search, found, ending, None, tuple(doubtful))
    return Unnamed(search, found, ending, rival)


def beside_one_form(
    search: Search, found: SearchNumbers, hints: Sequence[Hint]
) -> tuple[SearchNumbers, Candidate | None]:
    """The numbers, beside what one free form explains in place of all effects found; and that form.

    If it is likelier than several effects, they imitate it together, unless the first acts at its
    place and leaves little of it. If it acts elsewhere than the single effect found, that has the
    wrong place. At the effect's own place any curve explains a little more: that is structure only
    if the baseline's residual shows it (``hints``), or if it is most of what is left.
    """
    several = len(found.added) > 1
    limits = BESIDE_SEVERAL if several else BESIDE_ONE
    least, share = limits.points, limits.counts
    baseline = found.steps[0].at_least_error
    most = max([hint.points for hint in hints], default=0.0)
    hopeful = [h for h in hints[:TRIED] if h.points > HOPEFUL * found.gained]
    named = output_error_fit(found.path.model) if hopeful else baseline
    tried = list_candidates(search, baseline, hopeful)
    better = [
        one
        for one in tried
        if one.model is not None
        and 100 * (named.sse - one.model.sse) / search.criterion.power > excess_asked(one, found)
    ]
    if several and better:  # of which another may explain more of held-out rows
        n = len(tried)
        better = [*tried, *list_candidates(search, baseline, hints[n:FOLLOWED], n)]
    rival = find_best_minima(search, judge_forms(search, baseline, better)) if better else None
    if rival is None or rival.model is None:
        return found, None
    excess, one_cause = rival.gain - found.gained, False
    refutes = not first_stands(rival, found) if several else elsewhere(rival.effect, found)
    if refutes and excess > excess_asked(rival, found):
        lead_asked = 0.0 if several else 2 * THRESHOLD
        one_cause = (
            find_cost(search, found.path.model) - find_cost(search, rival.model) > lead_asked
        )
    effect: Any = rival.effect
    more = Leftover("shape", effect.over, ONE_FORM, excess, rival.delta_bic)
    at_sight = most >= found.gained + max(least * found.share, share * most)
    counts = excess >= least * found.share and (several or at_sight or excess > found.gained)
    left = sorted([*found.left, more] if counts else found.left, key=lambda item: -item.points)
    return replace(found, left=left, one_cause=one_cause), rival


def unnamed_parent(found: SearchNumbers, ending: Ending) -> Model:
    """The model with the effects that are named, without those that stand in for others."""
    model = found.path.model
    ids = [dict(model.effects.steps)[name].name for name in found.added]
    kept = sum(1 for name in ids if name in ending.named)
    return found.steps[kept].at_least_error


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
    first = effect.knots[0]
    if effect.over == TIME:  # before rows count, nothing tells it
        record = simulator.record
        first = max(first, float(record.t[record.known.any(axis=1)].min()))
    at = np.linspace(first, effect.knots[-1], N_POINTS)
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
