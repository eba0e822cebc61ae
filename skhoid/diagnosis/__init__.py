"""Where a fitted model fails: comparison with measured runs, ceiling, remnant, channels, scores."""

from .channels import check_channels
from .comparison import Comparison, compare
from .effect_search import EffectSearchCV
from .findings import Finding
from .remnant import RemnantEstimate, remnant_estimate
from .scores import performance_scores

__all__ = [
    "Comparison",
    "EffectSearchCV",
    "Finding",
    "RemnantEstimate",
    "check_channels",
    "compare",
    "performance_scores",
    "remnant_estimate",
]
