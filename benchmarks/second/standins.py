"""Stand-ins for the search, to check the trial itself: one that knows, one that is silent, one that
cheats.

Open it to add another. A stand-in is a function of (case, delay) that returns an object with
``fit``, ``best_effects_`` and ``best_estimator_``.
"""

from typing import Any

import numpy as np
import pandas as pd

from .cases import Case


class Standin:
    """Answers with fixed names, a prediction of the fresh runs and a delay."""

    def __init__(self, names: list[str], prediction: np.ndarray, delay: float, half_width: float):
        self.best_effects_ = names
        self.prediction = prediction
        row = {
            "value": delay,
            "sd": half_width / 2,
            "low": delay - half_width,
            "high": delay + half_width,
        }
        self.parameters_ = pd.DataFrame([row], index=["tau_e"])

    @property
    def best_estimator_(self) -> "Standin":
        return self

    def fit(self, X: Any, y: Any) -> "Standin":
        return self

    def predict(self, X: Any) -> np.ndarray:
        return self.prediction


def oracle(case: Case, delay: float | None) -> Standin:
    """Knows everything: must be right in all, without a false name, and cover the delay."""
    names = [] if case.hidden is None else [one[0] for one in case.hidden.each]
    return Standin(names, case.truth(case.new), case.world.delay, 0.01)


def deaf(case: Case, delay: float | None) -> Standin:
    """Hears nothing: must score 0 % of the hidden ones."""
    return Standin([], np.zeros(len(case.truth(case.new))), 0.2, 0.01)


def inverse(case: Case, delay: float | None) -> Standin:
    """Sells the plant's inverse as a person: must be caught wherever the disturbance is hidden."""
    return Standin(["output_feedback"], case.world.inverse(case.closed, case.new)[0], 0.0, 0.01)
