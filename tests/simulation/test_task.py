"""What tracking tasks accept and refuse."""

import numpy as np
import pytest

from skhoid import (
    CompensatoryTask,
    ControlledElement,
    HumanOperator,
    Ramp,
    Remnant,
    Step,
)
from skhoid.simulation import Condition

OMEGA = np.geomspace(0.05, 40.0, 30)

# Tasks


def test_task_of_a_condition():
    task = CompensatoryTask.of_condition("C2", duration=10.0, operator=HumanOperator(K_e=0.05))
    assert task.controlled_element == ControlledElement(30.0, 0.2)
    assert task.operator.K_e == 0.05
    own = Condition("mine", ControlledElement(1.0), HumanOperator(tau_e=0.1))
    assert CompensatoryTask.of_condition(own).operator == own.operator
    assert CompensatoryTask.of_condition("C1") == CompensatoryTask()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"display": np.nan}, "display must be a finite number; got nan"),
        ({"display": "pursuite"}, "display must be 'compensatory', 'pursuit', .*got 'pursuite'"),
        ({"transport": "hold"}, "transport must be 'held', 'interpolated' or None; got 'hold'"),
        ({"duration": 0.005}, "0.005 s at 100.0 Hz are fewer than two samples"),
        ({"sampling_rate": 1e308}, "81.92 s at 1e\\+308 Hz, with the run-in, are more samples"),
        ({"duration": 0.2, "run_in": 0.05}, "delay tau_e = 0.28 s is longer than the run of 0.2"),
        (
            {"operator": HumanOperator(tau_e=0.285), "transport": "held"},
            "is 28.5 samples at 100 Hz",
        ),
        ({"operator": HumanOperator(tau_e=0.005)}, "less than one sample at 100 Hz"),
    ],
)
def test_senseless_tasks(options, message):
    with pytest.raises(ValueError, match="CompensatoryTask: .*" + message):
        CompensatoryTask(**options)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"sampling_rate": 10.0}, r"neuromuscular mode \(omega_nm, zeta_nm\) of 11.25 rad/s"),
        ({"operator": HumanOperator(zeta_nm=20.0)}, r"neuromuscular mode .* of 449.7 rad/s"),
        (
            {"controlled_element": ControlledElement(1.0, 100.0)},
            r"controlled element \(omega_b\) of 100 rad/s",
        ),
        ({"remnant": Remnant(gain=0.1, time_constant=0.01)}, "remnant filter of 100 rad/s"),
    ],
)
def test_sampling_that_is_too_slow(options, what):
    with pytest.raises(ValueError, match="Hz is too slow for the " + what) as caught:
        CompensatoryTask(**options)
    advised = float(str(caught.value).split("sampling_rate=")[1].split(" ")[0])
    CompensatoryTask(**(options | {"sampling_rate": advised}))
    with pytest.raises(ValueError, match="too slow"):
        CompensatoryTask(**(options | {"sampling_rate": 0.9 * advised}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"controlled_element": ControlledElement(lambda t: 2 - t)},
            r"K_c is -0.005 at t = 2.005 s",
        ),
        ({"operator": HumanOperator(T_L=Step(-0.5, 0.4, 0.0))}, r"T_L is -0.5 at t = -0.0\d s"),
        ({"operator": HumanOperator(K_edot=lambda t: np.nan)}, "K_edot is nan at t = -0.5 s"),
        ({"operator": HumanOperator(K_x=lambda t: np.inf)}, "K_x is inf .* must be finite, in"),
        ({"display": Ramp(1, -1, 0, 2)}, "display is -0.005 at t = 1.005 s"),
        ({"target": lambda t: np.where(t < 1, 0.0, np.nan)}, "target is nan at t = 1 s"),
        ({"target": np.zeros(7)}, r"target must have 350 samples \(50 in the run-in and 300 in"),
    ],
)
def test_senseless_functions_of_time(options, message):
    task = CompensatoryTask(**({"duration": 3.0, "run_in": 0.5} | options))
    with pytest.raises(ValueError, match=message):
        task.simulate()


@pytest.mark.parametrize("name", ["e", "f_t", "x"])
def test_responses_of_a_pursuit_operator(name):
    operator = HumanOperator(K_e=0.07, K_edot=0.03, K_t=0.02, K_tdot=0.01, K_x=-0.03, K_xdot=-0.02)
    gains = {"e": (0.07, 0.03), "f_t": (0.02, 0.01), "x": (-0.03, -0.02)}[name]
    alone = HumanOperator(K_e=1.0, T_L=0.0).frequency_response(OMEGA)
    expected = (gains[0] + gains[1] * 1j * OMEGA) * alone
    np.testing.assert_allclose(operator.frequency_response(OMEGA, input=name), expected)
    with pytest.raises(ValueError, match="input must be 'e', or 'f_t' or 'x'"):
        operator.frequency_response(OMEGA, input="q")
