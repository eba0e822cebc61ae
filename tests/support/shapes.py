"""A shape of what has no name, made by hand; and a person who does what no catalogue has."""

import numpy as np
import pandas as pd

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Dimension, Effect, FreeMap, Parameter
from skhoid.search import Shape


class Fechner(Effect):
    """A response that grows with the logarithm of the error, which no catalogue has."""

    name = "fechner"
    place = "input"
    parameters = (Parameter("knee", Dimension(e=1), 0.01, 10.0, (0.3,)),)

    def __init__(self, *, knee=None):
        self.knee = knee

    def apply(self, signal, record, knee):
        return np.sign(signal) * knee * np.log1p(np.abs(signal) / knee)


def searched(hidden_effect, seed=0, channels=("e",), **options):
    """A search in runs of a person with an effect."""
    X, y = make_tracking_runs(
        condition="C1",
        n_runs=4,
        remnant_intensity=0.1,
        random_state=seed,
        effects=hidden_effect,
        channels=list(channels),
    )
    return EffectSearchCV(OperatorRegressor(), **options).fit(X, y), X, y


def a_shape(**given):
    """A wave over the error, with two names near it."""
    at = np.linspace(-2.0, 2.0, 101)
    value = 0.3 * np.sin(2 * at)
    curve = pd.DataFrame(
        {"value": value, "low": value - 0.05, "high": value + 0.05}, pd.Index(at, name="e")
    )
    knots = tuple(np.linspace(-2.0, 2.0, 11).tolist())
    effect = FreeMap(knots=knots, values=(0.0,) * 11)
    nearest = pd.DataFrame(
        {
            "title": ["cubic gain", "dead zone"],
            "form": ["", "gap"],
            "distance": [0.214, 0.44],
            "within_band": [True, False],
            "parameters": ["hardening = -0.2 1/deg^2", "width = 0.3 deg"],
        },
        pd.Index(["cubic_gain", "dead_zone"], name="effect"),
    )
    whole = {
        "sentence": "it acts on the error, as a function of its size and sign",
        "curve": curve,
        "x_label": "error e, deg",
        "y_label": "departure from a straight line, deg",
        "dof": 9.66,
        "gain": 9.86,
        "delta_bic": 4321.0,
        "closed": 0.984,
        "effect": effect,
        "name": "free_0",
        "estimator": None,
        "nearest": nearest,
        "recordings": ["To tell cubic gain from dead zone, record more."],
        "nearest_curve": curve["value"] * 0.9,
    }
    return Shape(**{**whole, **given})


def nothing_near():
    """What a shape says where no name is near it."""
    return {"nearest": a_shape().nearest.iloc[:0], "recordings": [], "nearest_curve": None}
