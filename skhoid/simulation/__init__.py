"""Simulation of the closed loop: forcing functions, remnant, conditions, runs."""

from .conditions import Condition, mixed_condition, tracking_condition
from .forcing import Multisine
from .remnant import Remnant
from .task import CompensatoryTask
from .tracking_record import TrackingRecord
from .tracking_runs import make_tracking_runs
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
