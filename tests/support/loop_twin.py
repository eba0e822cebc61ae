"""Tasks for tests of the loop, and how they are run by the naive twin."""

import numpy as np
from support import naive_loop

from skhoid import (
    ARXRegressor,
    CompensatoryTask,
    HumanOperator,
    Multisine,
    Remnant,
    Sigmoid,
    mixed_condition,
)

DISPLAYS = {"compensatory": 0.0, "pursuit": 1.0}
DISTURBANCE = Multisine(
    multiples=(5, 9, 27), amplitudes=(0.05, 0.03, 0.02), phases=(0.1, 2.0, -1.0)
)
SIGNALS = ("e", "u", "x", "n")


def unit_noise(task, n_runs=1, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n_runs, task.n_run_in + task.n_samples))


def whole(task, n_runs=1, **options):
    """Simulate and keep the run-in."""
    return task.simulate(n_runs, keep_run_in=task.n_run_in / task.sampling_rate, **options)


def twin(task, f_t, f_d, white, *, open_loop=False, **options):
    """One run by the naive twin, of signals as wide as the run-in and the window."""
    operator, element, remnant = task.operator, task.controlled_element, task.remnant
    varying = False
    if isinstance(operator, HumanOperator):
        varying = callable(operator.omega_nm) or callable(operator.zeta_nm)
        names = ("K_e", "omega_nm", "zeta_nm", "K_t", "K_tdot", "K_x", "K_xdot", "tau_e")
        options |= {name: getattr(operator, name) for name in names}
        options["K_edot"] = operator.K_edot
        if operator.K_edot is None:
            options["K_edot"] = lambda t: (
                naive_loop.at(operator.K_e, t) * naive_loop.at(operator.T_L, t)
            )
        exact = operator.tau_e * task.sampling_rate
        whole_samples = abs(exact - round(exact)) <= 1e-6
        if whole_samples:
            options["tau_e"] = round(exact) / task.sampling_rate
        options["interpolated"] = task.transport == "interpolated" or (
            task.transport is None and not whole_samples
        )
    if remnant is not None:
        options |= {"order": remnant.order, "K_n": remnant.gain, "T_n": remnant.time_constant}
    return naive_loop.simulate(
        f_t,
        f_d,
        white,
        rate=task.sampling_rate,
        begin=-task.n_run_in,
        K_c=element.K_c,
        omega_b=element.omega_b,
        shown=DISPLAYS[task.display] if isinstance(task.display, str) else task.display,
        closed=not open_loop,
        varying_muscle=varying,
        **options,
    )


def assert_agrees(record, found_by_twin, run=0):
    for name, expected in zip(SIGNALS, found_by_twin, strict=True):
        found = getattr(record, name)[run]
        size = np.abs(expected).max()
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=1e-10 * size + 1e-300, err_msg=name
        )


def assert_twin(task, *, seed=0, open_loop=False, run=0, **options):
    noise = unit_noise(task, run + 1, seed)
    record = whole(task, run + 1, noise=noise, open_loop=open_loop)
    f_t, f_d = record.f_t[0], record.f_d[0]
    assert_agrees(record, twin(task, f_t, f_d, noise[run], open_loop=open_loop, **options), run=run)


def assert_records_equal(record, other):
    for name in (*SIGNALS, "time", "f_t", "f_d"):
        np.testing.assert_array_equal(getattr(record, name), getattr(other, name), err_msg=name)


def short_task(**options):
    """Two seconds from C1 to C2 with everything that varies, varying."""
    changing = mixed_condition("C1", "C2", Sigmoid(0, 1, rate=4.0, time=0.8))
    defaults = {
        "remnant": Remnant(order=2, gain=Sigmoid(0.02, 0.04, rate=4.0, time=0.8)),
        "disturbance": DISTURBANCE,
        "duration": 2.0,
        "run_in": 0.5,
    }
    return CompensatoryTask.of_condition(changing, **(defaults | options))


def fitted_arx(na=2, nb=2, nk=29):
    rng = np.random.default_rng(0)
    e = rng.standard_normal((300, 1))
    return ARXRegressor(na=na, nb=nb, nk=nk, dt=0.01).fit(e, rng.standard_normal(300))
