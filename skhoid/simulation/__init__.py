"""Simulation of the closed loop: forcing functions, remnant, conditions, runs."""

from .conditions import Condition, Remnant, mixed_condition, tracking_condition
from .engine import TrackingRecord
from .forcing import Multisine
from .task import CompensatoryTask, tune_remnant
from .tracking_runs import make_tracking_runs

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
