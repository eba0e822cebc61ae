"""Experiments with several people: planning, simulation and analysis."""

from .analyse import analyse_experiment
from .group import GroupEffectSearch
from .people import PeopleResult, identify_people
from .recommend import ForgettingAdvice, recommend_forgetting
from .result import ExperimentResult
from .simulate import simulate_experiment
from .statistics import (
    MixedModelResult,
    RepeatedMeasuresResult,
    mixed_model,
    repeated_measures,
    write_long,
    write_wide,
)

__all__ = [
    "ExperimentResult",
    "ForgettingAdvice",
    "GroupEffectSearch",
    "MixedModelResult",
    "PeopleResult",
    "RepeatedMeasuresResult",
    "analyse_experiment",
    "identify_people",
    "mixed_model",
    "recommend_forgetting",
    "repeated_measures",
    "simulate_experiment",
    "write_long",
    "write_wide",
]
