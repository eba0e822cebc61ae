"""Simulation of the closed loop: forcing functions, remnant, conditions, runs."""

# What the lab uses, and no user needs.
from .conditions import ORDERS as ORDERS
from .conditions import RATES as RATES
from .conditions import T_M as T_M
from .conditions import Condition, Remnant, mixed_condition, tracking_condition
from .conditions import known_name as known_name
from .engine import RunOptions as RunOptions
from .engine import TrackingRecord
from .engine import entropy_of as entropy_of
from .engine import operator_response as operator_response
from .engine import simulate as simulate
from .forcing import Multisine
from .task import CompensatoryTask, tune_remnant
from .task import change_times as change_times
from .tracking_runs import OF_TASK as OF_TASK
from .tracking_runs import check_channel_names as check_channel_names
from .tracking_runs import frames_of as frames_of
from .tracking_runs import make_tracking_runs
from .tracking_runs import task_of as task_of
from .tracking_runs import truth_of as truth_of

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
