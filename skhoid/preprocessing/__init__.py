"""Row-preserving transformers for stock scikit-learn pipelines."""

from .base import as_fitted as as_fitted
from .gate import as_output as as_output
from .resampling import resample_runs
from .transformers import Decimator, DelayShift, RunInTrimmer
from .transformers import doubt_long_delay as doubt_long_delay
from .transformers import run_in_rows as run_in_rows

# What the lab uses, and no user needs.

__all__ = ["Decimator", "DelayShift", "RunInTrimmer", "resample_runs"]
