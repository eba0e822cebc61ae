"""Where a fitted model fails: comparison with measured runs, ceiling, remnant, scores."""

from .comparison import Comparison, compare
from .identification import Identification as Identification
from .identification import ModelChoice as ModelChoice
from .identification import identify as identify
from .remnant_estimate import RemnantEstimate, remnant_estimate
from .scores import performance_scores

__all__ = [
    "Comparison",
    "RemnantEstimate",
    "compare",
    "performance_scores",
    "remnant_estimate",
]
