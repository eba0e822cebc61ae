"""Every option of every public function with values without sense."""

import inspect

import numpy as np
import pytest
from support.fuzzing import outcome
from support.hostile import BAD

import skhoid
from skhoid import ARXRegressor, ControlledElement, HumanOperator

SHORT = {"duration": 20.48, "sampling_rate": 50}
RUNS = {"n_runs": 2, "duration": 40.96, "sampling_rate": 50}
LONG = {"analyse_experiment", "report", "recommend_forgetting", "simulate_experiment"}
LONG |= {"recommend_method", "run_tournament"}
WARN = {"crossover_path", "tune_remnant"}  # of what was not found


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    """A call of each function that makes sense, as positional and named arguments."""
    X, y = skhoid.make_tracking_runs(
        "C1", channels=["e", "x", "f_t"], remnant_intensity=0.1, random_state=0, **RUNS
    )
    model = ARXRegressor(nk=15).fit(X, y)
    folder = tmp_path_factory.mktemp("runs")
    skhoid.write_runs(X, y, folder / "runs.csv")
    columns = {"inputs": ["e"], "output": "u", "time": "time", "run": "run"}
    theta = [-1.91212, 0.92427, 0.04428, -0.04318]
    person, element = HumanOperator(), ControlledElement()
    return {
        "arx_to_operator": ((theta, 0.01), {}),
        "auto_psd": ((X,), {}),
        "check_channels": ((X, y), {}),
        "check_experiment": ((X, y), {}),
        "compare": ((model, X, y), {}),
        "crossover": ((person, element), {}),
        "ensemble_average": ((X, y), {}),
        "forgetting_factor": ((10,), {}),
        "fourier_coefficients": ((X, y), {"forcing": 2 * np.pi / 40.96 * np.array([3, 7])}),
        "load_bicycle_rider": ((), {}),
        "load_human_tracking": ((0,), {}),
        "identify_people": ((ARXRegressor(nk=15), X, y), {"ceiling": False}),
        "lost_control": ((X,), {}),
        "make_tracking_runs": (("C1", 1), SHORT),
        "mixed_condition": (("C1", "C2", 0.5), {}),
        "operator_parameters": ((model,), {}),
        "performance_scores": ((X, y), {"windows": ["T_m"]}),
        "read_experiment": ((str(folder / "{subject}.csv"),), columns),
        "read_runs": ((folder / "runs.csv",), columns),
        "reference_fits": ((X, y), {}),
        "remnant_estimate": ((model, X, y), {}),
        "resample_runs": ((X, y), {}),
        "run_labels": ((X,), {}),
        "sampling_time": ((X,), {}),
        "select_runs": ((X, y), {"first": 1}),
        "tracking_condition": (("C1",), {}),
        "vaf_score": ((y, y), {}),
        "write_runs": ((X, y, folder / "again.csv"), {"overwrite": True}),
        "zoh_parameters": ((person, 0.01), {}),
    }


FUNCTIONS = [name for name in skhoid.__all__ if inspect.isfunction(getattr(skhoid, name))]


@pytest.mark.fuzz
@pytest.mark.parametrize("name", sorted({*FUNCTIONS} - LONG - WARN))
def test_an_option_without_sense_is_refused_or_taken(name, calls, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what is given as a path may be one
    function = getattr(skhoid, name)
    args, kwargs = calls[name]
    given = inspect.signature(function).bind(*args, **kwargs).arguments
    _, error = outcome(function, **given)
    assert error is None, error
    problems = []
    for option in inspect.signature(function).parameters:
        for value in BAD:
            try:
                outcome(function, **{**given, option: value})
            except AssertionError as error:
                problems.append(f"{option}={value!r}: {error}")
    assert not problems, "\n".join(problems)
