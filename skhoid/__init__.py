"""Identify human operators, who steer in a closed loop, from recorded runs.

``X`` holds the input channels, ``y`` the operator's output, both with ``run`` and ``time`` in the
index. Estimators, searches and transformers follow the scikit-learn API. By task:

- Data: `read_runs`, `write_runs`, `resample_runs`, `run_labels`, `sampling_time`, `select_runs`,
  `check_channels`; recordings `load_human_tracking`, `load_bicycle_rider`.
- Preprocess, in pipelines: `Decimator`, `DelayShift`, `RunInTrimmer`; outside them
  `ensemble_average`.
- Identify: `ARXRegressor`; delay and orders by `DelaySearchCV`, `OrderSearchCV`; the physical
  model `OperatorRegressor`.
- Track a change: `RecursiveARX`, `RecursiveARXCV`, `forgetting_factor`.
- Validate: `vaf_score`, `VAFScorer`, `compare`, `remnant_estimate`, `performance_scores`.
- Find what is missing: `EffectSearchCV`, `report`; the catalogue is `skhoid.effects`, and
  `skhoid.testing` checks effects of your own.
- Interpret: `operator_parameters`, `zoh_parameters`, `arx_to_operator`, `reference_fits`,
  `crossover`, `crossover_path`, `fourier_coefficients`, `FrequencyResponse`, `auto_psd`.
- Simulate: `make_tracking_runs`, `CompensatoryTask`, `tracking_condition`, `mixed_condition`,
  `HumanOperator`, `ControlledElement`, `Remnant`, `tune_remnant`, `Multisine`; what varies over
  time is a `Sigmoid`, `Step`, `Ramp` or `Mixture`.
- Plan an experiment: `recommend_forgetting`, `MonteCarloStudy`, `simulate_experiment`,
  `analyse_experiment`.
- Draw: `skhoid.plotting`. Errors and warnings to catch: `skhoid.exceptions`.

>>> from skhoid import ARXRegressor, make_tracking_runs, vaf_score
>>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, random_state=0)
>>> model = ARXRegressor(nk=29).fit(X, y)
>>> print(f"VAF {vaf_score(y, model.predict(X)):.1f} %")
VAF 88.2 %
"""

from ._version import __version__ as __version__
from .arx.batch import ARXRegressor
from .arx.forgetting import forgetting_factor
from .arx.recursive import RecursiveARX
from .arx.recursive_cv import RecursiveARXCV
from .arx.searches import DelaySearchCV, OrderSearchCV
from .diagnosis import Comparison, RemnantEstimate, compare, performance_scores, remnant_estimate
from .exceptions import (
    IrregularSamplingError,
    MissingDataWarning,
    PoorExcitationWarning,
    RankDeficiencyError,
    RemnantIntensityError,
    RunCutWarning,
    RunIndexError,
    RunTimeWarning,
    SamplingJitterWarning,
    ShortRunError,
    StudyFolderError,
    StudyWarning,
    UnstableLoopError,
    WorkersLostError,
)
from .experiment import analyse_experiment, simulate_experiment
from .experiment.recommend import recommend_forgetting
from .greybox import OperatorRegressor
from .human import (
    ControlledElement,
    HumanOperator,
    Mixture,
    Ramp,
    Sigmoid,
    Step,
    crossover,
    zoh_parameters,
)
from .interpret import FrequencyResponse, auto_psd, crossover_path, fourier_coefficients
from .interpret.conversion import arx_to_operator, operator_parameters
from .interpret.references import reference_fits
from .io import load_bicycle_rider, load_human_tracking, read_runs, write_runs
from .metrics import VAFScorer, vaf_score
from .montecarlo import MonteCarloStudy
from .preprocessing import Decimator, DelayShift, RunInTrimmer, resample_runs
from .preprocessing.ensemble import ensemble_average
from .recordings.channels import check_channels
from .recordings.findings import Finding
from .reporting import Report, report
from .runs.selection import run_labels, sampling_time, select_runs
from .search.effect_search import EffectSearchCV
from .simulation import (
    CompensatoryTask,
    Multisine,
    Remnant,
    make_tracking_runs,
    mixed_condition,
    tracking_condition,
    tune_remnant,
)

__all__ = [
    "ARXRegressor",
    "Comparison",
    "CompensatoryTask",
    "ControlledElement",
    "Decimator",
    "DelaySearchCV",
    "DelayShift",
    "EffectSearchCV",
    "Finding",
    "FrequencyResponse",
    "HumanOperator",
    "IrregularSamplingError",
    "MissingDataWarning",
    "Mixture",
    "MonteCarloStudy",
    "Multisine",
    "OperatorRegressor",
    "OrderSearchCV",
    "PoorExcitationWarning",
    "Ramp",
    "RankDeficiencyError",
    "RecursiveARX",
    "RecursiveARXCV",
    "Remnant",
    "RemnantEstimate",
    "RemnantIntensityError",
    "Report",
    "RunCutWarning",
    "RunInTrimmer",
    "RunIndexError",
    "RunTimeWarning",
    "SamplingJitterWarning",
    "ShortRunError",
    "Sigmoid",
    "Step",
    "StudyFolderError",
    "StudyWarning",
    "UnstableLoopError",
    "VAFScorer",
    "WorkersLostError",
    "analyse_experiment",
    "arx_to_operator",
    "auto_psd",
    "check_channels",
    "compare",
    "crossover",
    "crossover_path",
    "ensemble_average",
    "forgetting_factor",
    "fourier_coefficients",
    "load_bicycle_rider",
    "load_human_tracking",
    "make_tracking_runs",
    "mixed_condition",
    "operator_parameters",
    "performance_scores",
    "read_runs",
    "recommend_forgetting",
    "reference_fits",
    "remnant_estimate",
    "report",
    "resample_runs",
    "run_labels",
    "sampling_time",
    "select_runs",
    "simulate_experiment",
    "tracking_condition",
    "tune_remnant",
    "vaf_score",
    "write_runs",
    "zoh_parameters",
]
