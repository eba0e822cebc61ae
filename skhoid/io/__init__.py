"""Recorded runs from files, and real recordings that come with the package."""

from .datasets import load_bicycle_rider, load_human_tracking
from .experiments import read_experiment
from .readers import read_runs
from .writers import write_runs

__all__ = [
    "load_bicycle_rider",
    "load_human_tracking",
    "read_experiment",
    "read_runs",
    "write_runs",
]
