"""Where a fitted model fails: comparison with measured runs, ceiling, remnant, scores."""

from .comparison import Comparison, compare
from .remnant_estimate import RemnantEstimate, remnant_estimate
from .scores import performance_scores

__all__ = [
    "Comparison",
    "RemnantEstimate",
    "compare",
    "performance_scores",
    "remnant_estimate",
]
