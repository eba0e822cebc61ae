"""``Shape``: what a search shows of an effect that has no name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from ..effects.free_form import FreeForm
from ..effects.registry import titles_of
from ..model.estimator import vaf_of_output
from ..model.fitting import Criterion, RemnantModel
from ..model.likelihood import TOLERATED, settled
from ..model.model import Model
from ..model.parameters import effects_with_values
from ..model.prepared import Prepared, SimulatedModel
from ..model.smoothing import N_FINE, crowded, in_detail
from ..text import Summary, TextTable, number
from .all_runs import on_rows_of
from .band import curve_with_band
from .candidates import AS_GOOD, LEAST_GAIN, Candidate
from .formulas import Fitted, formula_of
from .forward import CLAIM, Search, output_error_fit
from .held_out import held_out
from .leftover import leftovers
from .nearest import nearest_effects, nearest_table, recordings_for
from .search_numbers import gap_of
from .shapes import Shaped

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
NAMES_AHEAD = "Nearest names, by distance (0: the same curve; 1: nothing in common):"
BY_HAND = 'search.sketch_effect("my_effect", "my_effect.py")'
LEAD = "The shape of what has no name: "
NO_FORM = "No free form explains it at any place either"


@dataclass(frozen=True, eq=False, repr=False)
class Shape:
    """An effect without a name: where it acts, its curve, and what it explains.

    Parameters
    ----------
    id : str
        Of the free form, such as ``"free_map"``.
    place : str
        Where it acts, as ``Effect.place`` has it; ``"rate"`` for a map of the output's rate.
    over : str
        What the curve is a function of: ``"e"``, ``"time"``, ``"lag"``, a channel ...
    channel : str or None
        The channel that it responds to, or that the curve is a function of, if there is one.
    sentence : str
        The same in words.
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

    id: str
    place: str
    over: str
    channel: str | None
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

    def sentences(self) -> list[str]:
        """What is known of it, without the curve.

        Returns
        -------
        sentences : list of str
            Where it acts and what it explains, the nearest names, a formula if one fits, what to
            record, and how to make it an effect of your own.
        """
        loop = ""
        if np.isfinite(self.gain_loop):
            loop = f" (in the closed loop by {self.gain_loop:.1f})"
        told = [
            f"{LEAD}{self.sentence}; a curve with {self.dof:.1f} "
            f"effective degrees of freedom raises the held-out VAF by {self.gain:.1f} points"
            f"{loop}, {100 * self.closed:.0f} % of what {self._beside} leaves to explain."
        ]
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
    def _beside(self) -> str:
        """The model to which it was added, in words."""
        others = [effect.name for own, effect in self.estimator.effects_ if own != self.name]
        named = [name for name in others if name != CLAIM]
        words = [titles_of(named)] if named else []
        if CLAIM in others:  # estimated beside the shape: whether the given one is wrong is open
            words.append("a free delay")
        return f"the model with {' and '.join(words)}" if words else "the baseline"

    def summary(self) -> Summary:
        """All of it in plain sentences, and the curve as a table.

        Returns
        -------
        text : Summary
            A string that notebooks show line by line.
        """
        first, *others = self.sentences()
        lines = [first, "", *self.curve_table().lines(), ""]
        if len(self.nearest):
            others.remove(self._names())
            lines.append(NAMES_AHEAD)
            for row in self.nearest_table().rows:
                lines.append(f"  - {row[0]}: {row[1]}, {row[2]} the band; {row[3]}".rstrip("; "))
            lines.append("")
        return Summary("\n".join([*lines, *others]))

    def curve_table(self, n_points: int = POINTS) -> TextTable:
        """The curve at a few points as text, with its band.

        Parameters
        ----------
        n_points : int, default=9
            How many, at equal distances.

        Returns
        -------
        table : TextTable
        """
        rows = np.linspace(0, len(self.curve) - 1, n_points).round().astype(int)
        cells = []
        for at, row in self.curve.iloc[rows].iterrows():
            half = float(row["high"] - row["low"]) / 2
            value, low, high = (number(float(row[key]), half) for key in ("value", "low", "high"))
            cells.append([f"{float(str(at)):.3g}", value, f"{low} to {high}"])
        return TextTable("Curve", [self.x_label, self.y_label, "95 % band"], cells)

    def nearest_table(self) -> TextTable:
        """The nearest effects of the catalogue as text.

        Returns
        -------
        table : TextTable
        """
        cells = []
        for _, row in self.nearest.iterrows():
            called = row["title"] + (f" ({row['form']})" if row["form"] else "")
            within = "within" if row["within_band"] else "not within"
            cells.append([called, f"{row['distance']:.2f}", within, row["parameters"]])
        return TextTable("Nearest names", ["", "distance", "band", "its numbers"], cells)

    def plot(self, ax: Any = None) -> Any:
        """Draw the curve with its band.

        Parameters
        ----------
        ax : Axes or None, default=None
            Where to draw. None makes a figure.

        Returns
        -------
        display : ShapeDisplay
        """
        from ..plotting import ShapeDisplay

        return ShapeDisplay.from_shape(self, ax=ax)

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

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


def told_shape(ids: Sequence[str], shape: Shape | None) -> list[str]:
    """What a search says of the shape of what has no name, or that there is none; by ids found."""
    if list(ids)[-1:] != ["unknown"]:
        return []
    return [f"{NO_FORM}."] if shape is None else shape.sentences()


def labels_of(model: Model, name: str, units: dict[str, str | None]) -> tuple[str, str]:
    """Names and units of both axes."""
    effect: Any = dict(model.effects.steps)[name]
    first = next(p for p in model.simulator.parameters if p.name.startswith(f"{name}__"))
    x, y = effect.abscissa.label(units), first.dimension.label(units)
    over = AXES.get(effect.over, effect.over)
    if effect.over == "e" and model.simulator.record.domain == "machine":
        over = str(model.simulator.record.inputs[0])
    return _with_unit(over, x), _with_unit(effect.y_word, y)


def sentence_of(effect: FreeForm, domain: str) -> str:
    """Where a free form acts; a machine has no error that it sees, and no command."""
    if domain != "machine":
        return effect.sentence
    return effect.sentence.replace("the error", "the input").replace("the command", "the input")


def _with_unit(quantity: str, unit: str) -> str:
    """A quantity and its unit, where it has one that is known."""
    return quantity if unit == "-" or "[" in unit else f"{quantity}, {unit}"


def shape_of(
    candidate: Candidate, estimator: Any, closed: float, units: dict[str, str | None]
) -> Shape:
    """What a search shows of the best free form, in a fitted estimator that has it."""
    model = candidate.model
    assert model is not None
    effect: Any = dict(effects_with_values(model).steps)[candidate.name]
    curve, dof = curve_with_band(model, candidate.name)
    x_label, y_label = labels_of(model, candidate.name, units)
    values = model.values()
    gains = values.get("K_e", 1.0), values.get("K_edot", 0.0)
    record = replace(model.simulator.record, prediction=model.output)
    near = nearest_effects(effect, curve, record, units, gains)
    loop = candidate.in_loop
    return Shape(
        id=effect.name,
        place="rate" if effect.over == "du/dt" else effect.place,
        over=effect.over,
        channel=getattr(effect, "channel", None),
        sentence=sentence_of(effect, model.simulator.record.domain),
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
        formula=formula_of(effect, curve, dof, record),
    )


def detailed(search: Search, found: Candidate) -> Candidate:
    """The best form with knots enough for its details, unless held-out rows speak against them.

    Where the data use most of them, as for a gain that vanishes for seconds, more are tried.
    """
    assert found.model is not None
    before = output_error_fit(found.model)

    def vaf_of(model: Model) -> float:
        return vaf_of_output(search.record, held_out(model, search.criterion, search.folds))

    plain = before
    start = vaf = vaf_of(before)
    while (few := _n_knots(plain, found.name) < N_FINE) or crowded(plain, found.name):
        least = max(N_FINE, 2 * _n_knots(plain, found.name) - 1)
        finer = in_detail(plain, found.name, least) if least <= MOST_KNOTS else plain
        asked = -AS_GOOD if few else LEAST_GAIN * search.share
        if finer is plain or not (new := vaf_of(finer)) - vaf > asked:
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


def fitted_shape(
    shaped: Shaped, model: SimulatedModel, prepared: Prepared, measured: np.ndarray
) -> Shape | None:
    """The shape of a search on all rows; None where there is none.

    The loop is blind to answers that the target cannot tell from another gain. A form that it alone
    speaks against is the shape where it explains most of what repeats from run to run, since no
    remnant does that.
    """
    if shaped.shape is not None:
        return _fitted(shaped, shaped.shape, model, prepared, measured)
    repeated = max([i.points for i in shaped.found.left if i.where == "repeats"], default=0.0)
    for one in shaped.doubtful if repeated else ():
        shape = _fitted(shaped, one, model, prepared, measured)
        if shape is not None and gap_of(shape.estimator, prepared, measured)[0] < repeated / 2:
            return shape
    return None


def _unbiased(fitted: Model, criterion: Criterion) -> tuple[Model, RemnantModel]:
    """A model and its noise model, estimated in turn; as it was where its free run gets much worse.

    A noise model that is nearly an integrator leaves slow curves undetermined.
    """
    plain = Criterion(fitted.simulator.record)
    found, noise = settled(fitted, criterion)
    if plain.sse(found.output) <= TOLERATED * plain.sse(fitted.output):
        return found, noise
    criterion.set_noise(criterion.remnant_model(fitted.output))
    return fitted.under(criterion), criterion.noise


def _fitted(
    shaped: Shaped,
    found: Candidate,
    model: SimulatedModel,
    prepared: Prepared,
    measured: np.ndarray,
) -> Shape | None:
    """The shape of one candidate."""
    if found.model is None:
        return None
    found = detailed(shaped.search, found)
    assert found.model is not None
    fitted = on_rows_of(prepared.record, output_error_fit(found.model))
    best = model.with_fit(prepared, *_unbiased(fitted, Criterion(prepared.record)))
    best.set_params(effects=found.model.effects)
    rest, _, _, _ = gap_of(best, prepared, measured)
    if not np.isfinite(rest):
        folds = shaped.search.folds
        rest = max([item.points for item in leftovers(fitted, folds)], default=0.0)
    closed = float(found.gain / max(found.gain + max(rest, 0.0), 1e-300))
    return shape_of(found, best, closed, prepared.units)
