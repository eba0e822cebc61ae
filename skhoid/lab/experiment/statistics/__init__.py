"""Statistics of a parameter over people and conditions, and files for other programs."""

from ._kenward_roger import FTest
from .export import write_long, write_wide
from .mixed import mixed_model
from .repeated import RepeatedMeasuresResult, repeated_measures
from .result import MixedModelResult

__all__ = [
    "FTest",
    "MixedModelResult",
    "RepeatedMeasuresResult",
    "mixed_model",
    "repeated_measures",
    "write_long",
    "write_wide",
]
