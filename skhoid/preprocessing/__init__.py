"""Row-preserving transformers for stock scikit-learn pipelines."""

from .resampling import resample_runs
from .transformers import Decimator, DelayShift, RunInTrimmer

__all__ = ["Decimator", "DelayShift", "RunInTrimmer", "resample_runs"]
