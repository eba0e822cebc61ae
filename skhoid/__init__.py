"""Model human operators, who steer in a closed loop, from recorded runs.

``X`` holds the input channels, ``y`` the operator's output, both with ``run`` and ``time`` in the
index. Estimators, searches and transformers follow the scikit-learn API. By task:

- Data: `read_runs`, `read_experiment`, `write_runs`, `resample_runs`, `run_labels`,
  `sampling_time`, `select_runs`, `check_channels`, `check_experiment`, `lost_control`; recordings
  `load_human_tracking`, `load_bicycle_rider`.
- Preprocess, in pipelines: `Decimator`, `DelayShift`, `RunInTrimmer`; outside them
  `ensemble_average`.
- Identify: `ARXRegressor`; delay and orders with `DelaySearchCV`, `OrderSearchCV`;
  with effects `SimulatedARX`, or the physical model `OperatorRegressor`.
- Track a change: `RecursiveARX`, `RecursiveARXCV`, `forgetting_factor`; without the bias of remnant
  `RecursiveBoxJenkins`, `RecursiveIV`; by other means `OperatorKalman`, `DelayBankARX`,
  `RecursiveFIR`, `WindowedOperator`, `SigmoidOperator`, `WaveletOperator`, `LPVARX`; which of them,
  `recommend_method`, `run_tournament`.
- Validate: `vaf_score`, `VAFScorer`, `compare`, `remnant_estimate`, `performance_scores`.
- Find what is missing: `EffectSearchCV`, `report`; the catalogue is `skhoid.effects`, and
  `skhoid.testing` checks effects of your own.
- Interpret: `operator_parameters`, `zoh_parameters`, `arx_to_operator`, `reference_fits`,
  `crossover`, `crossover_path`, `fourier_coefficients`, `FrequencyResponse`, `auto_psd`.
- Simulate: `make_tracking_runs`, `CompensatoryTask`, `tracking_condition`, `mixed_condition`,
  `HumanOperator`, `ControlledElement`, `LinearElement`, `Remnant`, `tune_remnant`, `Multisine`;
  parameters that vary in time are a `Sigmoid`, `Step`, `Ramp` or `Mixture`.
- Plan an experiment: `recommend_forgetting`, `MonteCarloStudy`, `simulate_experiment`.
- Experiments with people: `identify_people`, `GroupEffectSearch`, `analyse_experiment`; statistics
  in `skhoid.lab.experiment`.
- Draw: `skhoid.plotting`. Errors and warnings to catch: `skhoid.exceptions`.

>>> from skhoid import ARXRegressor, make_tracking_runs, vaf_score
>>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, random_state=0)
>>> model = ARXRegressor(nk=29).fit(X, y)
>>> print(f"VAF {vaf_score(y, model.predict(X)):.1f} %")
VAF 88.2 %
"""

import lazy_loader

from ._version import __version__ as __version__

# The names are in __init__.pyi, next to this file; each is imported on first use.
__getattr__, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
_NAMESPACES = {
    "effects",
    "exceptions",
    "human",
    "interpret",
    "lab",
    "plotting",
    "testing",
}
# Without the namespaces: a star import would import matplotlib with skhoid.plotting.
__all__ = [name for name in _names if name not in _NAMESPACES]
