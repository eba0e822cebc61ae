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
from .metrics import VAFScorer, vaf_score
from .preprocessing import Decimator, DelayShift, RunInTrimmer
from .runs import resample_runs, run_labels, sampling_time, select_runs
