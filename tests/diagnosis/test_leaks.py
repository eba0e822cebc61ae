"""A prediction that is the output rebuilt from x is told from one that answers with a delay."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.unseen import DT, ELEMENTS, second_difference, simulate

from skhoid import make_tracking_runs
from skhoid.diagnosis.leaks import leak_test

pytestmark = pytest.mark.slow  # fits many models

SEEDS = 6


@pytest.fixture(scope="module", params=list(ELEMENTS))
def loop(request):
    disturbance = 1.0 if request.param == "1/s" else 2.0
    return simulate(request.param, SEEDS, seed=11, preview=0.4, disturbance=disturbance)


def of_run(loop, prediction, run, *, given=True, target=True, **options):
    element = (loop.b, loop.a) if given else None
    return leak_test(
        loop.u[:, run],
        prediction[:, run],
        loop.x[:, run],
        DT,
        element=element,
        target=loop.f[:, run] if target else None,
        **options,
    )


@pytest.mark.parametrize("given", [True, False])
def test_the_inverse_of_the_element_leaks_and_a_delayed_answer_does_not(loop, given):
    inverse = second_difference(loop)
    leaking = [of_run(loop, inverse, run, given=given) for run in range(SEEDS)]
    honest = [of_run(loop, loop.answer, run, given=given) for run in range(SEEDS)]
    assert [found.leaks for found in leaking] == [True] * SEEDS
    assert [found.leaks for found in honest] == [False] * SEEDS
    assert_allclose(np.median([found.slope for found in leaking]), 1.0, atol=0.15)
    assert min(found.slope for found in leaking) > 0.7
    assert max(found.slope for found in honest) < 0.2
    assert np.median([found.residual_with_disturbance for found in leaking]) < -0.9
    assert np.median([abs(found.residual_with_disturbance) for found in honest]) < 0.15
    closer = [found.correlation_with_inverse - found.reference for found in leaking]
    assert np.median(closer) > 0


def test_least_squares_on_x_without_delay_leaks(loop):
    now = np.stack([loop.x, *(np.pad(loop.x[:-k], ((k, 0), (0, 0))) for k in (1, 2))], axis=-1)
    for run in range(SEEDS):
        taps = np.linalg.lstsq(now[2:, run], loop.u[2:, run], rcond=None)[0]
        assert of_run(loop, now @ taps, run).leaks


@pytest.mark.parametrize("wrong", ["small", "early", "late", "nothing", "dead zone"])
def test_a_wrong_model_with_a_delay_does_not_leak(loop, wrong):
    prediction = {
        "small": 0.4 * loop.answer,
        "early": np.roll(loop.answer, -4, axis=0),
        "late": np.roll(loop.answer, 8, axis=0),
        "nothing": 0 * loop.answer,
        "dead zone": np.sign(loop.answer) * np.maximum(np.abs(loop.answer) - 1, 0),
    }[wrong]
    assert not any(of_run(loop, prediction, run).leaks for run in range(0, SEEDS, 2))


def test_runs_are_rows_of_long_records_or_columns(loop):
    by_column = leak_test(
        loop.u[:, :3],
        loop.answer[:, :3],
        loop.x[:, :3],
        DT,
        element=(loop.b, loop.a),
        target=loop.f[:, :3],
    )
    n = len(loop.u)
    rows = [slice(k * n, (k + 1) * n) for k in range(3)]
    u, answer, x, f = (v[:, :3].T.ravel() for v in (loop.u, loop.answer, loop.x, loop.f))
    by_rows = leak_test(u, answer, x, DT, rows, (loop.b, loop.a), target=f)
    assert by_rows == by_column


def test_without_a_disturbance_nothing_can_be_told():
    loop = simulate("1/s", 2, disturbance=0.0)
    found = of_run(loop, second_difference(loop), 0)
    assert found.leaks is None
    assert "too little" in found.reason


@pytest.mark.parametrize("condition", ["C3", pytest.param("C6")])
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
    found = leak_test(u, 0.8 * np.roll(u, -2, axis=0), x, 0.02, target=f)
    assert found.leaks is None
    assert "changes in time" in found.reason


def test_a_recorded_disturbance_that_the_model_is_not_told_is_a_probe(loop):
    inverse = second_difference(loop)
    for given in (True, False):
        options = {"given": given, "disturbance": loop.d[:, 0], "told": False}
        assert of_run(loop, inverse, 0, **options).leaks
        assert not of_run(loop, loop.answer, 0, **options).leaks


def test_without_element_and_target_the_estimate_would_be_biased(loop):
    found = of_run(loop, loop.answer, 0, given=False, target=False)
    assert found.leaks is None
    assert "biased by the loop" in found.reason


def test_records_that_are_too_short_say_so():
    loop = simulate("1/s", 1, duration=3.0)
    found = of_run(loop, loop.answer, 0)
    assert found.leaks is None
    assert "too short" in found.reason


def test_scale_and_offset_of_the_signals_do_not_matter(loop):
    plain = of_run(loop, loop.answer, 3)
    scaled = leak_test(
        3 * loop.u[:, 3] + 5,
        3 * loop.answer[:, 3] + 5,
        7 * loop.x[:, 3] + 2,
        DT,
        element=(loop.b * 7 / 3, loop.a),
        target=7 * loop.f[:, 3] + 2,
    )
    assert_allclose(scaled.slope, plain.slope, rtol=1e-6)
