"""Senseless arguments of simulated runs, and unstable loops."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from skhoid import (
    ARXRegressor,
    Decimator,
    HumanOperator,
    UnstableLoopError,
    make_tracking_runs,
)


def make(condition="C1", n_runs=2, **options):
    """Runs of four seconds after two of run-in."""
    return make_tracking_runs(condition, n_runs, **({"duration": 4.0, "run_in": 2.0} | options))


# Errors


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"condition": "C7"}, "Unknown condition 'C7'.*Did you mean 'C6'"),
        (
            {"channels": "e"},
            r"channels must list some of \['e', 'x', 'f_t', 'dist'\], each once; got 'e'",
        ),
        ({"channels": ["e", "f_d"]}, "channels must list"),
        ({"remnant_intensity": 15}, "15 percent is 0.15"),
        ({"remnant_intensity": 0.1, "remnant_gain": 0.02}, "remnant_intensity or remnant_gain"),
        ({"remnant_gain": "tabel"}, "'table'; got 'tabel'"),
        ({"remnant_gain": "table", "remnant_intensity": 0.12}, "Table G.1 has the orders"),
        ({"perturbation": {"K_c": 1.0}}, r"no parameter \['K_c'\] to add to; there are \['K_e'"),
        ({"perturbation": {"K_e": -1.0}}, r"K_e is -0.91 at t = -2 s"),
        ({"keep_run_in": 3.0}, "keep_run_in must lie between 0 and the run-in of 2 s; got 3.0"),
        (
            {"random_phases": True, "target": np.sin},
            "draws the phases of a Multisine, but the target is",
        ),
    ],
)
def test_senseless_arguments(options, message):
    with pytest.raises(ValueError, match=message):
        make(**options)


def test_models_that_do_not_fit_the_loop():
    X, y = make(channels=["e", "x"], remnant_gain=0.02, random_state=0)
    slow = ARXRegressor(nk=15).fit(*make(sampling_rate=50.0))
    with pytest.raises(ValueError, match=r"dt = 0.02 s.* sampling_rate=50"):
        make(operator=slow)
    two_inputs = ARXRegressor(nk=29, inputs=["e", "x"]).fit(X, y)
    with pytest.raises(ValueError, match="responds to the error e alone"):
        make(operator=two_inputs)
    thinned = make_pipeline(Decimator(factor=2), ARXRegressor(nk=15)).fit(X[["e"]], y)
    with pytest.raises(ValueError, match="without the Decimator"):
        make(operator=thinned)
    with pytest.raises(ValueError, match="not fitted"):
        make(operator=ARXRegressor())


# Unstable loops; every warning is an error here


@pytest.mark.parametrize(
    ("condition", "operator"),
    [
        ("C1", HumanOperator(K_e=0.2, T_L=0.4)),
        ("C2", HumanOperator(K_e=0.09, T_L=0.0)),
        ("C1", HumanOperator(K_e=0.07, T_L=1.2)),  # the operator of C2: a factor e in 4.4 s
    ],
)
@pytest.mark.parametrize("duration", [4.0, 0.5])
def test_constant_loops_that_are_unstable(condition, operator, duration):
    """Also where the run is too short for its own error to show it."""
    message = r"unstable: its error grows by a factor e every [\d.]+ s. Lower .*\(K_e\)"
    with pytest.raises(UnstableLoopError, match=message):
        make(condition, operator=operator, duration=duration)


def test_a_loop_that_is_unstable_for_a_moment_only():
    """The lag of a person who adapts is simulated, not refused."""
    X, _ = make("C6", adaptation_lag=10.0, duration=81.92, n_runs=1)
    assert np.isfinite(X.to_numpy()).all()
    prompt, _ = make("C6", duration=81.92, n_runs=1)
    after = (0, slice(41.0, None))
    assert X.loc[after, "e"].abs().max() > 1.2 * prompt.loc[after, "e"].abs().max()
