"""Where a fitted model fails: comparison with measured runs, ceiling, remnant, scores."""

# What the lab uses, and no user needs.
from .ceiling import consistent_ceiling as consistent_ceiling
from .ceiling import noise_ceiling as noise_ceiling
from .comparison import Comparison, compare
from .identification import ModelChoice as ModelChoice
from .identification import identify as identify
from .remnant_estimate import RemnantEstimate, remnant_estimate
from .scores import performance_scores
from .signals import read_signals as read_signals

__all__ = [
    "Comparison",
    "RemnantEstimate",
    "compare",
    "performance_scores",
    "remnant_estimate",
]
