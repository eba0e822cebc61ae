"""skhoid: identify human operators from recorded control loops."""

from .arx.batch import ARXRegressor
from .arx.searches import DelaySearchCV, OrderSearchCV
from .exceptions import (
    IrregularSamplingError,
    MissingDataWarning,
    RankDeficiencyError,
    RunCutWarning,
    RunIndexError,
    SamplingJitterWarning,
    ShortRunError,
)
from .human import ControlledElement, HumanOperator, Mixture, Ramp, Sigmoid, Step
from .io import load_bicycle_rider, load_human_tracking, read_runs
from .metrics import VAFScorer, vaf_score
from .preprocessing import Decimator, DelayShift, RunInTrimmer, resample_runs
from .selection import run_labels, sampling_time, select_runs

__version__ = "0.1.0"

__all__ = [
    "ARXRegressor",
    "ControlledElement",
    "Decimator",
    "DelaySearchCV",
    "DelayShift",
    "HumanOperator",
    "IrregularSamplingError",
    "MissingDataWarning",
    "Mixture",
    "OrderSearchCV",
    "Ramp",
    "RankDeficiencyError",
    "RunCutWarning",
    "RunInTrimmer",
    "RunIndexError",
    "SamplingJitterWarning",
    "ShortRunError",
    "Sigmoid",
    "Step",
    "VAFScorer",
    "load_bicycle_rider",
    "load_human_tracking",
    "read_runs",
    "resample_runs",
    "run_labels",
    "sampling_time",
    "select_runs",
    "vaf_score",
]
