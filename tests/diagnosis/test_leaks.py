"""A prediction that is the output rebuilt from x is told from one that answers with a delay."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.unseen import DT, ELEMENTS, second_difference, simulate

from skhoid import make_tracking_runs
from skhoid.diagnosis.leaks import LEAST_DELAY, leak_test

SEEDS = 4


@pytest.fixture(scope="module", params=list(ELEMENTS))
def loop(request):
    disturbance = 1.0 if request.param == "1/s" else 2.0
    return simulate(request.param, SEEDS, seed=11, preview=0.4, disturbance=disturbance)


def told_of(loop, prediction, run=0, told=True, **more):
    channels = {"x": loop.x[:, run], "f_t": loop.f[:, run], **more}
    u, u_hat = loop.u[:, run], prediction[:, run]
    return leak_test(u, u_hat, channels, DT, told=lambda _: told, least_delay=LEAST_DELAY)


def test_the_inverse_of_the_element_leaks_and_a_delayed_answer_does_not(loop):
    inverse = second_difference(loop)
    leaking = [told_of(loop, inverse, run) for run in range(SEEDS)]
    honest = [told_of(loop, loop.answer, run) for run in range(SEEDS)]
    assert [found.leaks for found in leaking] == [True] * SEEDS
    assert [found.leaks for found in honest] == [False] * SEEDS
    assert_allclose(np.median([found.slope for found in leaking]), 1.0, atol=0.15)
    assert max(found.slope for found in honest) < 0.2
    assert np.median([found.residual_with_disturbance for found in leaking]) < -0.9
    assert np.median([abs(found.residual_with_disturbance) for found in honest]) < 0.15


@pytest.mark.parametrize("wrong", ["small", "early", "late", "nothing", "dead zone"])
def test_a_wrong_model_with_a_delay_does_not_leak(loop, wrong):
    prediction = {
        "small": 0.4 * loop.answer,
        "early": np.roll(loop.answer, -4, axis=0),
        "late": np.roll(loop.answer, 8, axis=0),
        "nothing": 0 * loop.answer,
        "dead zone": np.sign(loop.answer) * np.maximum(np.abs(loop.answer) - 1, 0),
    }[wrong]
    assert not told_of(loop, prediction, 2).leaks


def test_runs_are_rows_of_long_records_or_columns(loop):
    options = {"told": lambda _: True, "least_delay": LEAST_DELAY}
    columns = loop.u[:, :3], loop.answer[:, :3], loop.x[:, :3], loop.f[:, :3]
    u, answer, x, f = columns
    by_column = leak_test(u, answer, {"x": x, "f_t": f}, DT, **options)
    n = len(loop.u)
    rows = [slice(k * n, (k + 1) * n) for k in range(3)]
    u, answer, x, f = (v.T.ravel() for v in columns)
    assert leak_test(u, answer, {"x": x, "f_t": f}, DT, rows, **options) == by_column


def test_without_a_disturbance_nothing_can_be_told():
    loop = simulate("1/s", 1, disturbance=0.0)
    found = told_of(loop, second_difference(loop))
    assert found.leaks is None
    assert "too little" in found.reason


@pytest.mark.parametrize("condition", ["C3", "C6"])
def test_an_element_that_changes_is_no_unseen_disturbance(condition):
    X, y = make_tracking_runs(
        condition,
        n_runs=3,
        remnant_intensity=0.1,
        channels=["x", "f_t"],
        sampling_rate=50,
        random_state=1,
    )
    u, x, f = (np.asarray(v, dtype=float).reshape(3, -1).T for v in (y, X["x"], X["f_t"]))
    early = 0.8 * np.roll(u, -2, axis=0)
    channels = {"x": x, "f_t": f}
    found = leak_test(u, early, channels, 0.02, told=lambda _: True, least_delay=LEAST_DELAY)
    assert found.leaks is None
    assert "changes in time" in found.reason


def test_a_recorded_disturbance_that_the_model_is_not_told_is_a_probe(loop):
    more = {"told": False, "dist": loop.d[:, 0]}
    assert told_of(loop, second_difference(loop), **more).leaks
    assert not told_of(loop, loop.answer, **more).leaks


def test_records_that_are_too_short_say_so():
    loop = simulate("1/s", 1, duration=3.0)
    found = told_of(loop, loop.answer)
    assert found.leaks is None
    assert "too short" in found.reason
