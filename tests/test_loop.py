"""The tracking loop against its naive twin, an independent oracle, SciPy, and itself."""

from dataclasses import replace

import closed_loop
import naive_loop
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete
from sklearn.pipeline import make_pipeline

from skhoid import (
    ARXRegressor,
    CompensatoryTask,
    ControlledElement,
    DelayShift,
    HumanOperator,
    Multisine,
    Ramp,
    Remnant,
    Sigmoid,
    Step,
    _kernels,
    make_tracking_runs,
    mixed_condition,
    vaf_score,
)
from skhoid.simulation.physics import physics_rows, response_of

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
        options["remnant_muscle"] = (remnant.omega_nm, remnant.zeta_nm)
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


def assert_agrees(record, found_by_twin, run=0, rtol=1e-10):
    for name, expected in zip(SIGNALS, found_by_twin, strict=True):
        found = getattr(record, name)[run]
        size = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=rtol * size + 1e-300, err_msg=name)


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


# The twin


@pytest.mark.parametrize("name", ["C1", "C2", "C3", "C4", "C5", "C6"])
def test_conditions_of_the_thesis(name):
    """Past the transition at 40.96 s, with the remnant gains of Table G.1."""
    remnant = Remnant.from_table(name, 0.15)
    task = CompensatoryTask.of_condition(name, remnant=remnant, duration=43.0, run_in=0.3)
    assert_twin(task)


@pytest.mark.parametrize("order", [1, 2, 3, 4, "nm"])
@pytest.mark.parametrize("open_loop", [False, True])
def test_remnant_orders(order, open_loop):
    gain = Ramp(0.01, 0.06, start=0.2, end=1.4)
    remnant = Remnant(order=order, gain=gain, time_constant=0.11, omega_nm=9.0, zeta_nm=0.5)
    assert_twin(short_task(remnant=remnant), open_loop=open_loop)


@pytest.mark.parametrize("transport", [None, "held", "interpolated"])
@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0, 1000.0])
def test_sampling_rates(rate, transport):
    task = short_task(sampling_rate=rate, transport=transport, duration=1.0, run_in=0.2)
    assert_twin(task)


@pytest.mark.parametrize(
    ("transport", "samples"),
    [("held", s) for s in (0, 1, 2, 28, 28.0000001, 27.9999999, 60)]
    + [("interpolated", s) for s in (1, 2, 28, 28.0000001, 27.9999999, 60)],
)
def test_whole_delays(transport, samples):
    task = short_task(transport=transport)
    assert_twin(replace(task, operator=replace(task.operator, tau_e=samples / 100)))


@pytest.mark.parametrize("samples", [1.25, 1.5, 1.75, 27.3, 28.001, 28.999, 60.5])
def test_fractional_delays(samples):
    task = short_task()
    assert_twin(replace(task, operator=replace(task.operator, tau_e=samples / 100)))


def test_interpolation_of_a_whole_delay_is_the_limit_of_fractional_delays():
    task = short_task(transport="interpolated")
    at_28, close = (
        whole(replace(task, operator=replace(task.operator, tau_e=tau)), random_state=0).u
        for tau in (0.28, 0.28 + 1e-7)
    )
    np.testing.assert_allclose(at_28, close, rtol=0, atol=1e-6)
    assert np.abs(at_28 - close).max() > 0


@pytest.mark.parametrize("display", ["pursuit", 0.3, Step(0.0, 1.0, time=0.7), Ramp(0, 1, 0, 1)])
def test_pursuit(display):
    operator = HumanOperator(
        K_e=0.05,
        K_edot=Sigmoid(0.03, 0.05, rate=5.0, time=1.0),
        K_t=0.03,
        K_tdot=Ramp(0.0, 0.02, 0.5, 1.0),
        K_x=-0.02,
        K_xdot=-0.01,
    )
    assert_twin(short_task(operator=operator, display=display))


def test_gains_on_the_target_are_not_in_use_on_a_compensatory_display():
    operator = HumanOperator(K_t=0.5, K_tdot=0.1, K_x=-0.2, K_xdot=0.3)
    with_gains = whole(short_task(operator=operator), random_state=0)
    assert_records_equal(with_gains, whole(short_task(operator=HumanOperator()), random_state=0))


def test_pursuit_gains_that_together_answer_the_error():
    """K_t = -K_x acts on f_t - x = e."""
    plain = HumanOperator(K_e=0.09, K_edot=0.036)
    split = HumanOperator(K_e=0.05, K_edot=0.03, K_t=0.04, K_x=-0.04, K_tdot=0.006, K_xdot=-0.006)
    task = short_task(operator=plain)
    one = whole(task, random_state=1)
    two = whole(replace(task, operator=split, display="pursuit"), random_state=1)
    np.testing.assert_allclose(two.u, one.u, rtol=0, atol=1e-13)


def test_muscle_that_varies():
    """A mass on a spring and a damper, not a filter whose memory is rescaled."""
    operator = HumanOperator(
        omega_nm=Sigmoid(11.25, 7.0, rate=6.0, time=1.0), zeta_nm=Ramp(0.35, 0.6, 0.2, 1.5)
    )
    assert_twin(short_task(operator=operator))


def test_disturbance_alone():
    task = short_task(target=lambda t: np.zeros_like(t), remnant=None)
    assert_twin(task)
    record = whole(task)
    assert np.abs(record.e).max() > 0.01
    np.testing.assert_array_equal(record.f_t, np.zeros_like(record.f_t))


@pytest.mark.parametrize("kind", ["array", "function", "multisine"])
def test_forcing_functions_of_every_kind(kind):
    f_t = Multisine(multiples=(1, 3), amplitudes=(1.0, 0.5), phases=(0.0, 1.0), period=1.7)
    t = np.arange(-50, 200) / 100
    given_as = {"array": f_t(t), "function": lambda t: f_t(t), "multisine": f_t}[kind]
    record = whole(short_task(target=given_as), random_state=0)
    np.testing.assert_allclose(record.f_t[0], f_t(t), rtol=0, atol=1e-14)
    assert_twin(short_task(target=given_as))


@pytest.mark.parametrize(("na", "nb", "nk"), [(2, 2, 29), (1, 1, 0), (0, 3, 1), (4, 2, 5)])
def test_arx_operator(na, nb, nk):
    rng = np.random.default_rng(na + 10 * nb)
    model = fitted_arx(na, nb, nk)
    poles = 0.7 * rng.uniform(-1, 1, na)
    a, b = np.poly(poles)[1:] if na else np.zeros(0), 0.02 * rng.standard_normal(nb)
    model.coef_ = np.concatenate([a, b])
    task = short_task(operator=model, controlled_element=ControlledElement(20.0, 4.0))
    assert_twin(task, arx=(a, b, nk))


def fitted_arx(na=2, nb=2, nk=29):
    rng = np.random.default_rng(0)
    e = rng.standard_normal((300, 1))
    return ARXRegressor(na=na, nb=nb, nk=nk, dt=0.01).fit(e, rng.standard_normal(300))


@st.composite
def tasks(draw):
    """Stable tasks of all kinds, half a second to two seconds long."""
    rate = draw(st.sampled_from([50.0, 100.0, 200.0]))
    middle = st.floats(0.0, 0.8)
    steep = st.floats(1.0, 100.0)

    def varying(low, high):
        value = st.floats(low, high)
        kind = draw(st.sampled_from(["constant", "sigmoid", "step", "ramp"]))
        if kind == "constant":
            return draw(value)
        p_i, p_f, t_M = draw(value), draw(value), draw(middle)
        if kind == "sigmoid":
            return Sigmoid(p_i, p_f, rate=draw(steep), time=t_M)
        if kind == "step":
            return Step(p_i, p_f, time=t_M)
        return Ramp(p_i, p_f, start=t_M, end=t_M + 0.3)

    gains = {name: varying(-0.02, 0.02) for name in ("K_t", "K_tdot", "K_x", "K_xdot")}
    lead = draw(st.sampled_from(["T_L", "K_edot"]))
    gains[lead] = varying(0.3, 0.7) if lead == "T_L" else varying(0.02, 0.05)
    transport = draw(st.sampled_from([None, "held", "interpolated"]))
    samples = draw(st.integers(1, 15))
    if transport != "held":
        samples += draw(st.sampled_from([0.0, 0.1, 0.5, 0.9]))
    operator = HumanOperator(
        K_e=varying(0.03, 0.08),
        tau_e=samples / rate,
        omega_nm=varying(6.0, 20.0),
        zeta_nm=varying(0.2, 1.0),
        **gains,
    )
    return CompensatoryTask(
        controlled_element=ControlledElement(K_c=varying(20, 60), omega_b=varying(3, 8)),
        operator=operator,
        remnant=Remnant(order=draw(st.sampled_from([1, 2, 3, 4, "nm"])), gain=varying(0, 0.1)),
        disturbance=draw(st.sampled_from([None, DISTURBANCE])),
        display=draw(st.sampled_from(["compensatory", "pursuit", 0.5, Step(0, 1, 0.4)])),
        duration=draw(st.floats(0.5, 1.5)),
        run_in=draw(st.sampled_from([0.0, 0.21, 0.5])),
        sampling_rate=rate,
        transport=transport,
    )


@settings(max_examples=50, deadline=None)
@given(tasks(), st.integers(0, 2**31), st.booleans(), st.sampled_from([0, 1, 7]))
def test_any_task(task, seed, open_loop, run):
    assert_twin(task, seed=seed, open_loop=open_loop, run=run)


# Independent computations


@pytest.mark.parametrize("state", ["C1", "C2"])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("interpolated", [False, True])
def test_oracle(state, order, interpolated):
    """Over the eight windows of the thesis's Monte Carlo."""
    gain = 0.02
    expected = closed_loop.simulate(
        state, remnant_gain=gain, remnant_order=order, rng=5, interpolated_delay=interpolated
    )
    task = CompensatoryTask.of_condition(
        state,
        remnant=Remnant(order=order, gain=gain),
        transport="interpolated" if interpolated else "held",
    )
    white = np.random.default_rng(5).standard_normal((1, 65536))
    found = task.simulate(noise=white)
    assert_agrees(found, [getattr(expected.last(), name) for name in SIGNALS])
    np.testing.assert_allclose(found.f_t[0], expected.last().f_t, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("transport", "tau", "bound"),
    [("held", 0.0, 2e-5), ("held", 0.1, 2e-5), ("interpolated", 0.1, 2e-5), (None, 0.1053, 1e-4)],
)
def test_error_of_runge_kutta(transport, tau, bound):
    """Against solve_ivp on every step: small at 100 Hz, and the fourth power of the step.

    A fractional delay has a corner inside the step, which costs Runge-Kutta its order.
    """
    operator = HumanOperator(
        K_e=Sigmoid(0.05, 0.08, rate=3.0, time=0.4), T_L=0.4, tau_e=tau, zeta_nm=0.5
    )
    element = ControlledElement(Sigmoid(40.0, 60.0, rate=3.0, time=0.4), 6.0)

    def integrated(derivative, state, dt):
        corner = 1.0 if transport else (tau / dt) % 1
        for part in ((0.0, corner), (corner, 1.0)):
            if part[0] < part[1]:
                state = solve_ivp(
                    lambda t, z: np.array(derivative(list(z), t)) * dt,
                    part,
                    state,
                    method="DOP853",
                    rtol=1e-11,
                    atol=1e-13,
                ).y[:, -1]
        return list(state)

    def error(rate):
        task = CompensatoryTask(
            controlled_element=element,
            operator=operator,
            remnant=Remnant(order=2, gain=0.03),
            duration=0.6,
            run_in=0.0,
            sampling_rate=rate,
            transport=transport,
        )
        noise = np.repeat(np.random.default_rng(2).standard_normal(60), round(rate / 100))
        record = task.simulate(noise=noise)
        exact = twin(task, record.f_t[0], record.f_d[0], noise, step=integrated)
        return np.abs(record.x[0] - exact[2]).max() / np.abs(exact[2]).max()

    coarse = error(100.0)
    assert coarse < bound
    if transport:
        assert coarse / error(200.0) == pytest.approx(16.0, rel=0.35)


@pytest.mark.parametrize("state", ["C1", "C2"])
def test_controlled_element_at_the_lines(state):
    """In steady state x answers the held u as K_c / (s (s + omega_b)) under zero-order hold."""
    task = CompensatoryTask.of_condition(state)
    record = task.simulate()
    lines = np.array(Multisine().multiples)
    U, X = (np.fft.rfft(signal[0])[lines] for signal in (record.u, record.x))
    K_c, omega_b = task.controlled_element.K_c, task.controlled_element.omega_b
    b, a, _ = cont2discrete(([K_c], [1.0, omega_b, 0.0]), 0.01)
    z = np.exp(1j * Multisine().omega * 0.01)
    np.testing.assert_allclose(X / U, np.polyval(b.ravel(), z) / np.polyval(a, z), rtol=1e-6)
    below = Multisine().omega < 6.0
    H = task.controlled_element.frequency_response(Multisine().omega)
    half_sample = np.exp(-1j * Multisine().omega * 0.005)
    np.testing.assert_allclose((X / U)[below], (H * half_sample)[below], rtol=1e-3)


@pytest.mark.parametrize("state", ["C1", "C2"])
def test_operator_at_the_lines(state):
    """u answers e as the operator, up to the half sample for which f_t is held."""
    task = CompensatoryTask.of_condition(state, sampling_rate=1000.0, run_in=2 * 81.92)
    record = task.simulate()
    lines = np.array(Multisine().multiples)
    E, U = (np.fft.rfft(signal[0])[lines] for signal in (record.e, record.u))
    H = task.operator.frequency_response(Multisine().omega)
    # 17.6 rad/s for half a millisecond are 0.009 rad.
    np.testing.assert_allclose(U / E, H, rtol=0.012)


def test_arx_model_of_the_operator_in_its_place():
    """Fitted without remnant and put back, it closes the loop as the operator does."""
    X, y = make_tracking_runs("C1", n_runs=1)
    task = CompensatoryTask.of_condition("C1")
    original = task.simulate()
    model = ARXRegressor(na=2, nb=2, nk=29).fit(X, y)
    shifted = make_pipeline(DelayShift(delay=0.29), ARXRegressor(na=2, nb=2, nk=0)).fit(X, y)
    again = replace(task, operator=model).simulate()
    for name in ("x", "u", "e"):
        signal, repeated = getattr(original, name)[0], getattr(again, name)[0]
        assert vaf_score(signal, repeated) > 99.99, name
    behind = replace(task, operator=shifted).simulate()
    np.testing.assert_allclose(behind.u, again.u, rtol=0, atol=1e-6)


# Symmetries


def test_scaling_the_target_scales_all():
    task = short_task(remnant=None, disturbance=None)
    louder = replace(
        task, target=replace(task.target, amplitudes=3 * np.array(task.target.amplitudes))
    )
    one, three = whole(task), whole(louder)
    for name in SIGNALS:
        np.testing.assert_allclose(getattr(three, name), 3 * getattr(one, name), atol=1e-13, rtol=0)


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


@pytest.mark.parametrize("shift", [1, 30])
def test_time_shift_of_constant_dynamics(shift):
    task = CompensatoryTask.of_condition(
        "C2", remnant=Remnant(order=3, gain=0.05), duration=2.0, run_in=0.5
    )
    noise, f_t = unit_noise(task), task.target(np.arange(250) / 100)
    later_noise, later_f_t = np.roll(noise, shift, axis=1), np.roll(f_t, shift)
    later_noise[:, :shift], later_f_t[:shift] = 0.0, 0.0
    now = whole(replace(task, target=f_t), noise=noise)
    later = whole(replace(task, target=later_f_t), noise=later_noise)
    for name in SIGNALS:
        np.testing.assert_array_equal(
            getattr(later, name)[:, shift:], getattr(now, name)[:, :-shift]
        )
        np.testing.assert_array_equal(getattr(later, name)[:, :shift], 0.0)


def test_a_function_of_time_that_is_constant_is_a_constant():
    constant = short_task(
        operator=HumanOperator(), controlled_element=ControlledElement(), remnant=None
    )
    varying = replace(
        constant,
        operator=HumanOperator(K_e=lambda t: 0.09, T_L=lambda t: np.full(t.shape, 0.4)),
        controlled_element=ControlledElement(K_c=lambda t: 90.0),
    )
    np.testing.assert_allclose(whole(varying).u, whole(constant).u, rtol=0, atol=1e-15)


@pytest.mark.parametrize("random_phases", [False, True])
@pytest.mark.parametrize("n_runs", [1, 3, 8, 9, 17])
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


def test_order_of_runs_does_not_matter():
    task = short_task()
    noise = unit_noise(task, 11)
    order = np.random.default_rng(1).permutation(11)
    forward, permuted = whole(task, 11, noise=noise), whole(task, 11, noise=noise[order])
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(permuted, name), getattr(forward, name)[order])


def test_a_neighbour_that_is_loud_changes_no_bit():
    task = short_task()
    quiet = unit_noise(task, 8)
    loud = quiet.copy()
    loud[3] *= 1e5
    one, other = whole(task, 8, noise=quiet), whole(task, 8, noise=loud)
    kept = np.delete(np.arange(8), 3)
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(one, name)[kept], getattr(other, name)[kept])
    assert np.abs(other.u[3]).max() > 1e3 * np.abs(one.u[3]).max()


def test_noise_gives_the_runs_of_a_random_state():
    """Run i draws from SeedSequence(random_state, spawn_key=(0, i)): a promise, once released."""
    task = short_task()
    n_total = task.n_run_in + task.n_samples
    noise = [
        np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0, i))).standard_normal(n_total)
        for i in range(10)
    ]
    assert_records_equal(whole(task, 10, random_state=7), whole(task, 10, noise=noise))


def test_a_single_row_of_noise():
    task = short_task()
    noise = unit_noise(task)
    assert_records_equal(whole(task, noise=noise[0]), whole(task, noise=noise))


def test_random_states():
    task = short_task()
    assert_records_equal(
        whole(task, random_state=np.random.default_rng(3)),
        whole(task, random_state=np.random.default_rng(3)),
    )
    assert_records_equal(
        whole(task, random_state=np.random.RandomState(3)),
        whole(task, random_state=np.random.RandomState(3)),
    )
    assert not np.array_equal(whole(task).u, whole(task).u)
    assert not np.array_equal(whole(task, random_state=1).u, whole(task, random_state=2).u)


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


@pytest.mark.parametrize("kind", ["varying", "constant", "arx"])
def test_one_lane_and_eight_give_the_same_bits(kind):
    task = short_task()
    if kind != "varying":
        task = CompensatoryTask(remnant=Remnant(gain=0.02), duration=2.0, run_in=0.5)
    if kind == "arx":
        task = replace(task, operator=fitted_arx(), controlled_element=ControlledElement(1.0, 6.0))
    rng = np.random.default_rng(0)
    n = task.n_run_in + task.n_samples
    f_t, f_d, white = (np.ascontiguousarray(rng.standard_normal((n, 8))) for _ in range(3))
    rest = (
        *physics_rows(task), task.remnant.filter_coefficients(), *response_of(task).arguments,
        0.01, 1.0, 20, 1e9,
    )  # fmt: skip
    many, lost = _kernels.loop.track_many(f_t, f_d, white, *rest)
    assert many.shape == (4, n - 20, 8)
    np.testing.assert_array_equal(lost, np.full(8, -1))
    for j in range(8):
        columns = (np.ascontiguousarray(signal[:, [j]]) for signal in (f_t, f_d, white))
        one, _ = _kernels.loop.track_one(*columns, *rest)
        np.testing.assert_array_equal(one[..., 0], many[..., j])
    assert np.abs(many).max() > 0.1


def test_keeping_the_run_in_changes_nothing_else():
    task = short_task()
    window, kept = task.simulate(2, random_state=0), whole(task, 2, random_state=0)
    part = task.simulate(2, random_state=0, keep_run_in=0.2)
    np.testing.assert_array_equal(kept.time, np.arange(-50, 200) / 100)
    for name in (*SIGNALS, "f_t", "f_d"):
        np.testing.assert_array_equal(getattr(kept, name)[:, 50:], getattr(window, name))
        np.testing.assert_array_equal(getattr(kept, name)[:, 30:], getattr(part, name))
    np.testing.assert_array_equal(kept.intensity(), window.intensity())
    np.testing.assert_array_equal(kept.score(), window.score())


def test_progress_bar_changes_nothing(capsys):
    task = short_task()
    assert_records_equal(
        whole(task, 9, random_state=0, progress=True), whole(task, 9, random_state=0)
    )


def test_kernels_have_one_compiled_signature():
    for task in (short_task(), short_task(operator=fitted_arx(), run_in=0.0, duration=0.5)):
        for n_runs in (1, 3):
            for random_phases in (False, True):
                task.simulate(n_runs, random_state=np.int64(0), random_phases=random_phases)
    for kernel in (_kernels.loop.track_one, _kernels.loop.track_many):
        if hasattr(kernel, "signatures"):  # not under NUMBA_DISABLE_JIT=1
            assert len(kernel.signatures) <= 1
