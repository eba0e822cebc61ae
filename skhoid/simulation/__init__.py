"""The closed loop on the computer: forcing functions, remnant, conditions, runs."""

from .conditions import Condition, mixed_condition, tracking_condition
from .datasets import make_tracking_runs
from .forcing import Multisine
from .loop import CompensatoryTask
from .record import TrackingRecord
from .remnant import Remnant
from .tuning import tune_remnant

__all__ = [
    "CompensatoryTask",
    "Condition",
    "Multisine",
    "Remnant",
    "TrackingRecord",
    "make_tracking_runs",
    "mixed_condition",
    "tracking_condition",
    "tune_remnant",
]
