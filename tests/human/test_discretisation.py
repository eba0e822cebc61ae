"""Zero-order hold and whole delays against SciPy and the thesis's tables."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import cont2discrete
from support.closed_loop import ZOH_100HZ

from skhoid import HumanOperator, Sigmoid
from skhoid.human.operator import delay_samples, zoh_parameters

STATES = HumanOperator(K_e=0.09, T_L=0.4), HumanOperator(K_e=0.07, T_L=1.2)

# zoh.Ts<dt>.a1_a2_b0_b1_b0'_b1' of facts.json: Tables IV, F.1 and F.3.
TABLES = {
    0.005: [
        -1.9582883585774955,
        0.961390120245082,
        0.022467290684571095,
        -0.022188132134488336,
        0.052205129962033636,
        -0.051988006645302676,
    ],
    0.01: [*ZOH_100HZ["C1"], *ZOH_100HZ["C2"][2:]],
    0.08: [
        -0.9708674740156353,
        0.5325918010068972,
        0.26358393389718027,
        -0.21302874446796682,
        0.5714942544597001,
        -0.5321735515703117,
    ],
}


def scipy_zoh(K_e, K_edot, omega_nm, zeta_nm, dt):
    """Eq. F.4 from SciPy's state space, whose polynomials would stumble over leading zeros."""
    w2 = omega_nm**2
    A, B, C = [[0, 1], [-w2, -2 * zeta_nm * omega_nm]], [[0], [1]], [[K_e * w2, K_edot * w2]]
    A, B, C, _, _ = cont2discrete((np.array(A), np.array(B), np.array(C), np.zeros((1, 1))), dt)
    a1, a2 = -np.trace(A), np.linalg.det(A)
    b0, second = (C @ B).item(), (C @ A @ B).item()
    return [a1, a2, b0, second + a1 * b0]


@pytest.mark.parametrize("dt", TABLES)
def test_tables_of_the_thesis(dt):
    first, second = (zoh_parameters(operator, dt) for operator in STATES)
    np.testing.assert_allclose([*first, *second[2:]], TABLES[dt], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(first[:2], second[:2])


@given(
    K_e=st.floats(0.01, 2),
    K_edot=st.floats(0, 2),
    omega_nm=st.floats(1, 30),
    zeta_nm=st.floats(0.01, 10),
    dt=st.floats(0.002, 0.2),
)
def test_agrees_with_scipy_at_any_damping(K_e, K_edot, omega_nm, zeta_nm, dt):
    operator = HumanOperator(K_e=K_e, K_edot=K_edot, omega_nm=omega_nm, zeta_nm=zeta_nm)
    expected = scipy_zoh(K_e, K_edot, omega_nm, zeta_nm, dt)
    np.testing.assert_allclose(zoh_parameters(operator, dt), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-6, 1e-2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_is_right_on_and_near_critical_damping(distance, sign):
    zeta_nm = 1 + sign * distance
    operator = HumanOperator(zeta_nm=zeta_nm)
    expected = scipy_zoh(0.09, 0.036, 11.25, zeta_nm, 0.01)
    np.testing.assert_allclose(zoh_parameters(operator, 0.01), expected, rtol=1e-12, atol=1e-15)


def test_path_is_the_frozen_operator_at_each_instant():
    t = np.linspace(0, 80, 9)
    operator = HumanOperator(
        K_e=Sigmoid(0.09, 0.07, rate=0.5, time=40),
        T_L=Sigmoid(0.4, 1.2, rate=0.5, time=40),
        omega_nm=Sigmoid(11.25, 8.0, rate=0.2, time=30),
        zeta_nm=lambda t: 0.2 + 0.02 * t,
    )
    path = zoh_parameters(operator, 0.01, t)
    assert path.shape == (9, 4)
    frozen = [zoh_parameters(operator.at(instant), 0.01) for instant in t]
    np.testing.assert_allclose(path, frozen, rtol=1e-13)
    np.testing.assert_allclose(zoh_parameters(operator, 0.01, t[4]), path[4], rtol=1e-13)


@pytest.mark.parametrize(("dt", "nk"), [(0.02, 15), (0.01, 29), (0.005, 57), (0.28, 2)])
def test_delay_has_the_hold_sample(dt, nk):
    assert delay_samples(HumanOperator(tau_e=0.28), dt) == nk


def test_delay_between_samples():
    operator = HumanOperator(tau_e=0.28)
    with pytest.raises(ValueError, match=r"16\.8 samples.*nearest=True uses 17 \+ 1"):
        delay_samples(operator, 1 / 60)
    assert delay_samples(operator, 1 / 60, nearest=True) == 18
