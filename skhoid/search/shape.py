"""``Shape``: what a search shows of an effect that has no name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from ..effects.free_form import FreeForm
from ..greybox.estimates import effects_with_values
from ..greybox.fitting import Criterion, RemnantModel
from ..greybox.likelihood import TOLERATED, settled
from ..greybox.model import Model
from ..greybox.prepared import Prepared
from ..greybox.protocol import SimulatedModel
from ..greybox.smoothing import posterior_of
from .all_runs import on_rows_of
from .candidates import Candidate
from .forward import output_error_fit
from .leftover import leftovers
from .search_numbers import gap_of
from .shapes import Shaped

N_POINTS = 101
N_DRAWS = 4000
LEVEL = 0.95


@dataclass(frozen=True)
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


def curve_with_band(
    model: Model, name: str, n_points: int = N_POINTS
) -> tuple[pd.DataFrame, float]:
    """Curve of a free form of a model with a simultaneous band, and its degrees of freedom.

    The band is that of the posterior, enlarged so that it holds the whole curve: Ruppert, Wand and
    Carroll, Semiparametric regression (2003), section 6.5.
    """
    effect: Any = dict(model.effects.steps)[name]
    criterion = Criterion(model.simulator.record)
    criterion.set_noise(criterion.remnant_model(model.output))
    posterior = posterior_of(model, criterion)
    own = [i for i, n in enumerate(model.simulator.names) if n.startswith(f"{name}__")]
    at = np.linspace(effect.knots[0], effect.knots[-1], n_points)
    design = effect.design(at)
    covariance = posterior.covariance[np.ix_(own, own)]
    value = effect.at_rest + design @ model.theta[own]
    sd = np.sqrt(np.einsum("ij,jk,ik->i", design, covariance, design))
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal(np.zeros(len(own)), covariance, N_DRAWS, method="eigh")
    widest = np.abs(draws @ design.T / np.maximum(sd, 1e-300)).max(axis=1)
    half = float(np.quantile(widest, LEVEL)) * sd
    curve = pd.DataFrame(
        {"value": value, "low": value - half, "high": value + half},
        index=pd.Index(at, name=effect.over),
    )
    return curve, float(posterior.dof[own].sum())


def labels_of(model: Model, name: str, units: dict[str, str | None]) -> tuple[str, str]:
    """Names and units of both axes."""
    effect: Any = dict(model.effects.steps)[name]
    first = next(p for p in model.simulator.parameters if p.name.startswith(f"{name}__"))
    x, y = effect.abscissa.label(units), first.dimension.label(units)
    return f"{effect.over} ({x})", f"{effect.y_word} ({y})"


def shape_of(
    candidate: Candidate, estimator: Any, closed: float, units: dict[str, str | None]
) -> Shape:
    """What a search shows of the best free form, in a fitted estimator that has it."""
    model = candidate.model
    assert model is not None
    effect: Any = dict(effects_with_values(model).steps)[candidate.name]
    curve, dof = curve_with_band(model, candidate.name)
    x_label, y_label = labels_of(model, candidate.name, units)
    loop = candidate.in_loop
    return Shape(
        id=effect.name,
        place="rate" if effect.over == "du/dt" else effect.place,
        over=effect.over,
        channel=getattr(effect, "channel", None),
        sentence=effect.sentence,
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
        nearest=pd.DataFrame(
            columns=["title", "form", "distance", "within_band", "parameters"],
            index=pd.Index([], name="effect"),
        ),
        recordings=[],
    )


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
    fitted = on_rows_of(prepared.record, output_error_fit(found.model))
    best = model.with_fit(prepared, *_unbiased(fitted, Criterion(prepared.record)))
    best.set_params(effects=found.model.effects)
    rest, _, _, _ = gap_of(best, prepared, measured)
    if not np.isfinite(rest):
        folds = shaped.search.folds
        rest = max([item.points for item in leftovers(fitted, folds)], default=0.0)
    closed = float(found.gain / max(found.gain + max(rest, 0.0), 1e-300))
    return shape_of(found, best, closed, prepared.units)
