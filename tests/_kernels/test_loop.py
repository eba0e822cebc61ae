"""The tracking loop against its naive twin, an independent oracle, SciPy, and itself."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete
from sklearn.pipeline import make_pipeline
from support import closed_loop
from support.loop_twin import (
    DISTURBANCE,
    SIGNALS,
    assert_agrees,
    assert_records_equal,
    assert_twin,
    fitted_arx,
    short_task,
    twin,
    whole,
)

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
    vaf_score,
)

pytestmark = pytest.mark.slow  # compiles for many orders

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


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_that_of_numpy(seed):
    """Bit for bit, far enough for the rare numbers of the tails."""
    n = 20_000
    white = np.zeros((n, 3))
    _kernels.loop.draw(np.random.default_rng(seed), 10.0, white, 1)
    expected = 10.0 * np.random.default_rng(seed).standard_normal(n)
    np.testing.assert_array_equal(white[:, 1], expected)
    assert np.abs(expected).max() > 36.6  # beyond the last of NumPy's 256 layers
    assert not white[:, [0, 2]].any()


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
