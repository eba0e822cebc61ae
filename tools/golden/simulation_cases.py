"""Simulated runs: conditions, remnants, displays, rates, tasks, tuning, forcing, physics."""

from typing import Any

import numpy as np
from cases import case

import skhoid
from skhoid import (
    CompensatoryTask,
    ControlledElement,
    HumanOperator,
    Mixture,
    Multisine,
    Ramp,
    Remnant,
    Sigmoid,
    Step,
)

SHORT = {"sampling_rate": 50.0, "duration": 30.0, "run_in": 10.0}
ALL = ("e", "x", "f_t", "u", "n")


def runs(options: dict[str, Any], condition: Any = "C1", n_runs: int = 2) -> dict[str, Any]:
    options = {"random_state": 5, "channels": ("e", "x", "f_t"), "return_truth": True} | options
    X, y, truth = skhoid.make_tracking_runs(condition, n_runs, **options)
    return {"X": X, "y": y, "truth": dict(truth)}


for _name in ("C1", "C2", "C3", "C4", "C5", "C6"):
    _options = {"remnant_intensity": 0.15, "sampling_rate": 50.0}
    case(f"simulation/{_name}", options=_options, condition=_name)(runs)

for _name, _options in {
    "no remnant": {},
    "order 1": {"remnant_order": 1, "remnant_intensity": 0.1},
    "order 4": {"remnant_order": 4, "remnant_intensity": 0.1},
    "order nm": {"remnant_order": "nm", "remnant_intensity": 0.1},
    "gain of the table": {"remnant_gain": "table", "remnant_intensity": 0.15},
    "gain": {"remnant_gain": 0.01},
    "100 Hz": {"sampling_rate": 100.0, "remnant_intensity": 0.1},
    "200 Hz": {"sampling_rate": 200.0, "remnant_intensity": 0.1, "duration": 10.0},
    "own phases": {"random_phases": True, "remnant_intensity": 0.1},
    "open loop": {"open_loop": True, "remnant_intensity": 0.1},
    "disturbance": {"disturbance": Multisine().interleaved(random_state=0)},
    "kept run-in": {"keep_run_in": 5.0},
    "slow to adapt": {"adaptation_lag": 3.0},
    "perturbation": {"perturbation": {"K_e": skhoid.Ramp(0.0, 0.02, 5.0, 20.0)}},
    "pursuit": {
        "display": "pursuit",
        "operator": HumanOperator(K_t=0.03, K_x=0.02, K_xdot=0.01),
    },
    "own operator": {
        "operator": HumanOperator(K_e=Ramp(0.09, 0.05, 5.0, 20.0)),
        "controlled_element": ControlledElement(K_c=Step(90.0, 60.0, 15.0)),
    },
}.items():
    case(f"simulation/{_name}", options=SHORT | _options)(runs)


@case("simulation/mixed condition")
def mixed() -> dict[str, Any]:
    condition = skhoid.mixed_condition("C1", "C2", Sigmoid(0.0, 1.0, 2.0, 15.0))
    return runs(SHORT, condition) | {"condition": condition}


@case("simulation/task")
def tasks() -> dict[str, Any]:
    found = {}
    for name in ("C2", "C5"):
        task = CompensatoryTask.of_condition(name, remnant=Remnant(gain=0.01), sampling_rate=50.0)
        record = task.simulate(2, random_state=3)
        found |= {
            f"{name}/record": record,
            f"{name}/n_samples": [task.n_samples, task.n_run_in],
            f"{name}/intensity": record.intensity(),
            f"{name}/score": record.score(),
        }
    return found


@case("simulation/tuned remnant")
def tuned() -> dict[str, Any]:
    found = {}
    for order in (2, "nm"):
        task = CompensatoryTask.of_condition(
            "C4", remnant=Remnant(order=order, intensity=0.15), **SHORT
        )
        tuned = skhoid.tune_remnant(task, n_realisations=3, random_state=0)
        found[f"gain of order {order}"] = tuned.remnant.gain
    omega = np.geomspace(0.1, 30.0, 20)
    for order in (1, 2, 3, 4, "nm"):
        remnant = Remnant(order=order, gain=0.02)
        found[f"filter/{order}"] = remnant.filter_coefficients()
        found[f"response/{order}"] = remnant.frequency_response(omega)
    table = [Remnant.from_table(c, p).gain for c in ("C1", "C2", "C4") for p in (0.05, 0.15, 0.3)]
    return found | {"table": table}


@case("simulation/physics")
def physics() -> dict[str, Any]:
    t, omega = np.linspace(0.0, 80.0, 30), np.geomspace(0.1, 30.0, 20)
    varying = [
        Sigmoid(90.0, 30.0, 0.5, 40.96),
        Step(0.0, 1.0, 20.0),
        Ramp(0.0, 1.0, 10.0, 20.0),
        Mixture(0.09, Sigmoid(0.07, 0.05, 1.0, 60.0), Ramp(0.0, 1.0, 20.0, 30.0)),
    ]
    f_t = Multisine()
    operator, element = HumanOperator(K_e=0.07, T_L=1.2), ControlledElement(30.0, 0.2)
    return {
        "variations": [v(t) for v in varying],
        "multisine": [f_t(t), f_t.omega, f_t.crest_factor()],
        "interleaved": f_t.interleaved(random_state=0),
        "random phases": f_t.with_random_phases(random_state=0),
        "operator": operator.frequency_response(omega),
        "element": element.frequency_response(omega),
        "zoh_parameters": [skhoid.zoh_parameters(operator, dt) for dt in (0.005, 0.01, 0.02)],
        "crossover": skhoid.crossover(operator, element),
        "conditions": [skhoid.tracking_condition(f"C{i}") for i in range(1, 7)],
    }
