"""Row-preserving transformers for stock scikit-learn pipelines."""

from .decimation import Decimator
from .delay import DelayShift
from .run_in import RunInTrimmer

__all__ = ["Decimator", "DelayShift", "RunInTrimmer"]
