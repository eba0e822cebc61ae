"""The simultaneous band of a free form's curve."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..effects.free_forms import TIME
from ..model.fitting import Criterion
from ..model.model import Model
from ..model.smoothing import CROWDED, change_if_finer, change_if_rougher, posterior_of
from ..model.uncertainty import covariance_of

N_POINTS = 101
N_DRAWS = 4000
LEVEL = 0.95
AT_A_KINK = 3.0  # times the change by half the distance of knots; twice if nothing kept it back


def curve_with_band(
    model: Model, name: str, n_points: int = N_POINTS
) -> tuple[pd.DataFrame, float]:
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
    at = np.linspace(first, effect.knots[-1], n_points)
    design = effect.design(at)
    value = effect.at_rest + design @ model.theta[own]
    covariance = covariance_of(simulator, criterion, model.fit, simulator.prior)
    half = half_width(design, np.nan_to_num(covariance)[np.ix_(own, own)])
    rougher = design @ change_if_rougher(model, name, criterion)[own]
    half = half + np.abs(rougher) + np.abs(design @ change_if_slower(model)[own])
    dof = float(posterior_of(model, criterion).dof[own].sum())
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
