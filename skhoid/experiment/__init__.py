"""Experiments with several people: planned, simulated and analysed."""

from .people import analyse_experiment, simulate_experiment
from .recommend import ForgettingAdvice, recommend_forgetting
from .result import ExperimentResult

__all__ = [
    "ExperimentResult",
    "ForgettingAdvice",
    "analyse_experiment",
    "recommend_forgetting",
    "simulate_experiment",
]
