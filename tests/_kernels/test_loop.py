"""The tracking loop against its naive twin, an independent oracle, SciPy, and itself."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete
from support import closed_loop
from support.loop_twin import (
    DISTURBANCE,
    SIGNALS,
    assert_agrees,
    assert_twin,
    fitted_arx,
    short_task,
)

from skhoid import (
    CompensatoryTask,
    ControlledElement,
    HumanOperator,
    Multisine,
    Ramp,
    Remnant,
    Sigmoid,
    Step,
)

pytestmark = pytest.mark.slow  # compiles for many orders

# The twin


@pytest.mark.parametrize("samples", [0, 27.9999999])
def test_whole_delays(samples):
    task = short_task(transport="held")
    assert_twin(replace(task, operator=replace(task.operator, tau_e=samples / 100)))


def test_muscle_that_varies():
    """A mass on a spring and a damper, not a filter whose memory is rescaled."""
    operator = HumanOperator(
        omega_nm=Sigmoid(11.25, 7.0, rate=6.0, time=1.0), zeta_nm=Ramp(0.35, 0.6, 0.2, 1.5)
    )
    assert_twin(short_task(operator=operator))


@pytest.mark.parametrize(("na", "nb", "nk"), [(2, 2, 29), (0, 3, 1)])
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


@settings(max_examples=100, deadline=None)
@given(tasks(), st.integers(0, 2**31), st.booleans(), st.sampled_from([0, 1, 7]))
def test_any_task(task, seed, open_loop, run):
    assert_twin(task, seed=seed, open_loop=open_loop, run=run)


# Independent computations


@pytest.mark.parametrize("state", ["C1", "C2"])
@pytest.mark.parametrize("order", [1, 4])
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
