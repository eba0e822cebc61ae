"""Row-preserving transformers for stock scikit-learn pipelines."""

from .decimation import Decimator
from .delay_shift import DelayShift
from .resampling import resample_runs
from .run_in import RunInTrimmer

__all__ = ["Decimator", "DelayShift", "RunInTrimmer", "resample_runs"]
