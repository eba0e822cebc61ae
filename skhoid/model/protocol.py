"""What a search for missing effects needs from a model: look here to bring a model of your own."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import pandas as pd

from .fitting import RemnantModel
from .model import Model
from .prepared import Prepared

DOCUMENTED = 'docs/add-an-effect.md, "A model of your own", and skhoid.model.SimulatedModel'


class SimulatedModel(Protocol):
    """A scikit-learn regressor that simulates a core with effects, and that can be searched.

    ``OperatorRegressor`` and ``ARXRegressor`` are such models. The easiest way to a model of your
    own is a subclass of :class:`skhoid.model.GreyBox`, which has all of these but ``__init__``;
    any other class that has them will do. A search calls ``prepare`` and ``first_fit`` once, on a
    clone, tries effects on the record that it gets, and calls ``with_fit`` with what it found.

    Attributes
    ----------
    effects : Effect, Effects, str, list of these, or None
        Parameter: the model's effects.
    settling : float
        Parameter: seconds at the start of each run that do not count in the fit.
    parameters_ : DataFrame
        After a fit: value, sd, low, high, unit and meaning of each parameter.
    n_features_in_ : int
        After ``prepare``: number of columns of X.

    See Also
    --------
    EffectSearchCV : The search.
    """

    effects: Any
    settling: float
    parameters_: pd.DataFrame
    n_features_in_: int

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters, as in scikit-learn; the search clones the model."""

    def set_params(self, **params: Any) -> Any:
        """Set parameters; a search that is given a controlled element sets it in this way."""

    def fit(self, X: Any, y: Any) -> Any:
        """Estimate all parameters."""

    def predict(self, X: Any) -> np.ndarray:
        """Free run: one value for each row of X."""

    def score(self, X: Any, y: Any) -> float:
        """VAF of the free run in percent."""

    def with_effect(self, effect: Any) -> Any:
        """A new, unfitted model with one more effect."""

    def prepare(self, X: Any, y: Any) -> Prepared:
        """Read and check data: runs side by side as a record, and the core to simulate."""

    def first_fit(self, prepared: Prepared) -> Model:
        """The core with ``effects``, at the minimum of the plain simulation error."""

    def with_fit(self, prepared: Prepared, fitted: Model, noise: RemnantModel) -> Any:
        """A new estimator with the same settings and the estimates of ``fitted``."""

    def free_run(self, prepared: Prepared) -> np.ndarray:
        """The same as ``predict`` of the X that ``prepare`` read."""


METHODS = tuple(name for name in vars(SimulatedModel) if not name.startswith("_"))
PARAMETERS = ("effects", "settling")


def check_simulated_model(estimator: Any, purpose: str) -> None:
    """Refuse anything but a :class:`SimulatedModel`, and say what it lacks."""
    kind = estimator.__name__ if isinstance(estimator, type) else type(estimator).__name__
    if isinstance(estimator, type):
        raise TypeError(f"{purpose} takes a model, but got the class {kind}: pass {kind}().")
    lacking = [f"{name}()" for name in METHODS if not callable(getattr(estimator, name, None))]
    if "get_params()" not in lacking:
        known = estimator.get_params(deep=False)
        lacking += [f"the parameter {name}" for name in PARAMETERS if name not in known]
    if lacking:
        raise TypeError(
            f"{purpose} takes an OperatorRegressor, an ARXRegressor, or another model that "
            f"simulates effects; {kind} lacks {', '.join(lacking)}. For what such a model needs, "
            "see "
            f"{DOCUMENTED}."
        )
