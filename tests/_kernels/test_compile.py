"""All that fits call is compiled ahead by ``python -m skhoid.compile``."""

from importlib import import_module

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import skhoid
from skhoid import _kernels, compile, make_tracking_runs

MODELS = {
    "ARXRegressor": {"nk": 15},
    "RecursiveARX": {"nk": 15, "memory_time": 5.0, "smooth": True},
    "RecursiveARXCV": {"memory_horizons": [32.0, 128.0], "nk": 15},
    "RecursiveFIR": {"n_taps": 9, "nk": 15, "memory_time": 5.0, "every": 50},
    "RecursiveIV": {"nk": 15, "instruments": ["f_t"], "memory_time": 5.0},
    "RecursiveBoxJenkins": {"nk": 15, "memory_time": 5.0},
    "DelayBankARX": {"nk": [14, 15], "memory_time": 5.0},
    "OperatorKalman": {"init_window": 8.0, "smooth": True},
    "WindowedOperator": {},
    "OperatorRegressor": {"delay": 0.28},
}


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C1",
        2,
        channels=["e", "f_t"],
        duration=40.96,
        sampling_rate=50.0,
        remnant_intensity=0.15,
        random_state=0,
    )


def refuse(*args):
    raise AssertionError("Only kernels may call this: it is not compiled ahead.")


@pytest.fixture
def compiled_ahead(monkeypatch):
    """Kernels are loaded as after the command; what is compiled otherwise cannot be called."""
    for kernel in compile.find_kernels():
        kernel.load()
    for name in _kernels.MODULES:
        module = import_module(f"{_kernels.__name__}.{name}")
        for inner, value in list(vars(module).items()):
            if isinstance(value, Dispatcher):
                monkeypatch.setattr(module, inner, refuse)


@pytest.mark.parametrize("name", MODELS)
def test_a_fit_compiles_nothing_after(name, runs, compiled_ahead):
    X, y = runs
    model = getattr(skhoid, name)(**MODELS[name], inputs=["e"]).fit(X, y)
    assert np.isfinite(model.predict(X)).any()


def test_the_command_says_where_they_are(capsys):
    assert compile.main(["-j", "1"]) == 0
    told = capsys.readouterr()
    assert f"{len(compile.find_kernels())} kernels are compiled, in " in told.out
    assert not told.err
