"""Runs, time, marks and roles: the data convention, defined here for the whole package."""

from .alignment import SET_OUTPUT_HINT, check_alignment
from .clock import (
    GAP,
    JITTER_TOLERANCE,
    RUN,
    TIME,
    WHOLE,
    check_increasing,
    snap,
    time_in_seconds,
    whole_samples,
)
from .fingerprint import as_frame as as_frame

# What the lab uses, and no user needs.
from .fingerprint import fingerprint_of as fingerprint_of
from .index import run_index
from .layout import (
    RunLayout,
    check_levels,
    contiguous_runs,
    numbered,
    read_layout,
    run_name,
    run_time_index,
    within_runs,
)
from .marks import DecimationMark, mark_decimated, mark_run_column, mark_run_in
from .marks import is_mark as is_mark
from .roles import OUTPUT as OUTPUT
from .roles import input_columns, output_name, run_column
from .roles import of_person as of_person
from .roles import role_of as role_of
from .roles import roles_of as roles_of
from .selection import run_labels, sampling_time, select_runs

__all__ = [
    "GAP",
    "JITTER_TOLERANCE",
    "RUN",
    "SET_OUTPUT_HINT",
    "TIME",
    "WHOLE",
    "DecimationMark",
    "RunLayout",
    "check_alignment",
    "check_increasing",
    "check_levels",
    "contiguous_runs",
    "input_columns",
    "mark_decimated",
    "mark_run_column",
    "mark_run_in",
    "numbered",
    "output_name",
    "read_layout",
    "run_column",
    "run_index",
    "run_labels",
    "run_name",
    "run_time_index",
    "sampling_time",
    "select_runs",
    "snap",
    "time_in_seconds",
    "whole_samples",
    "within_runs",
]
