"""Experiments with several people: planning, simulation and analysis."""

from .analyse import analyse_experiment
from .recommend import ForgettingAdvice, recommend_forgetting
from .result import ExperimentResult
from .simulate import simulate_experiment

__all__ = [
    "ExperimentResult",
    "ForgettingAdvice",
    "analyse_experiment",
    "recommend_forgetting",
    "simulate_experiment",
]
