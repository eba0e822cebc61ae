"""Symmetries of the loop: linearity, time shifts, and independent runs."""

from dataclasses import replace

import numpy as np
import pytest
from support.loop_twin import (
    SIGNALS,
    assert_records_equal,
    fitted_arx,
    short_task,
    unit_noise,
    whole,
)

from skhoid import CompensatoryTask, ControlledElement, Remnant, Sigmoid, _kernels
from skhoid.simulation.engine import operator_response, physics_rows

# Symmetries


def test_superposition_of_target_disturbance_and_remnant():
    task = short_task()
    noise = unit_noise(task, 2)
    together = whole(task, 2, noise=noise)
    nothing = {"target": lambda t: 0.0 * t, "disturbance": None, "remnant": None}
    parts = [
        whole(replace(task, **(nothing | {name: getattr(task, name)})), 2, noise=noise)
        for name in nothing
    ]
    for name in SIGNALS:
        total = sum(getattr(part, name) for part in parts)
        np.testing.assert_allclose(getattr(together, name), total, rtol=0, atol=1e-13)
    assert min(np.abs(part.u).max() for part in parts) > 1e-3


@pytest.mark.parametrize("random_phases", [False, True])
@pytest.mark.parametrize("n_runs", [1, 9])
def test_a_run_is_the_same_whatever_the_others(n_runs, random_phases):
    task = short_task()
    options = {"random_state": 4, "random_phases": random_phases}
    all_runs = whole(task, 20, **options)
    for n_jobs in (1, 2):
        some = whole(task, n_runs, n_jobs=n_jobs, **options)
        for name in SIGNALS:
            np.testing.assert_array_equal(getattr(some, name), getattr(all_runs, name)[:n_runs])
        n_targets = n_runs if random_phases else 1
        assert some.f_t.shape == some.f_d.shape == (n_targets, some.time.size)
        np.testing.assert_array_equal(some.f_t, all_runs.f_t[:n_targets])
        np.testing.assert_array_equal(some.e, some.f_t - some.x)
    assert len(np.unique(all_runs.n[:, -1])) == 20
    assert len(np.unique(all_runs.f_t[:, -1])) == (20 if random_phases else 1)


def test_noise_gives_the_runs_of_a_random_state():
    """Run i draws from SeedSequence(random_state, spawn_key=(0, i)): a promise, once released."""
    task = short_task()
    n_total = task.n_run_in + task.n_samples
    noise = [
        np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0, i))).standard_normal(n_total)
        for i in range(10)
    ]
    assert_records_equal(whole(task, 10, random_state=7), whole(task, 10, noise=noise))


def test_open_loop_remnant_does_not_go_round():
    task = short_task()
    free = whole(replace(task, remnant=None), 3)
    opened = whole(task, 3, random_state=0, open_loop=True)
    closed = whole(task, 3, random_state=0)
    np.testing.assert_array_equal(opened.e, free.e)
    np.testing.assert_array_equal(opened.x, free.x)
    np.testing.assert_array_equal(opened.n, closed.n)
    np.testing.assert_array_equal(opened.u, free.u + opened.n)
    np.testing.assert_allclose(opened.u_without_remnant, free.u, rtol=0, atol=1e-15)
    assert np.abs(closed.e - free.e).max() > 0.1


@pytest.mark.parametrize("order", [2, 3, "nm"])
@pytest.mark.parametrize("kind", ["varying", "constant", "arx"])
def test_one_lane_and_eight_give_the_same_bits(kind, order):
    """With the third and fourth state of the remnant filter, and without where they are zero."""
    remnant = Remnant(order=order, gain=Sigmoid(0.02, 0.04, rate=4.0, time=0.8))
    task = short_task(remnant=remnant)
    if kind != "varying":
        remnant = Remnant(order=order, gain=0.02)
        task = CompensatoryTask(remnant=remnant, duration=2.0, run_in=0.5)
    if kind == "arx":
        task = replace(task, operator=fitted_arx(), controlled_element=ControlledElement(1.0, 6.0))
    rng = np.random.default_rng(0)
    n = task.n_run_in + task.n_samples
    f_t, f_d, white = (np.ascontiguousarray(rng.standard_normal((n, 8))) for _ in range(3))
    rest = (
        *physics_rows(task), task.remnant.filter_coefficients(), *operator_response(task).arguments,
        0.01, 1.0, 20, 1e9,
    )  # fmt: skip
    has_third = order == 3
    many, lost = _kernels.loop.tracker(has_third)(f_t, f_d, white, *rest)
    assert many.shape == (4, n - 20, 8)
    np.testing.assert_array_equal(lost, np.full(8, -1))
    for j in range(8):
        columns = (np.ascontiguousarray(signal[:, [j]]) for signal in (f_t, f_d, white))
        one, _ = _kernels.loop.tracker(True)(*columns, *rest)
        np.testing.assert_array_equal(one[..., 0], many[..., j])
    assert np.abs(many).max() > 0.1
