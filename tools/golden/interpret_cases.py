"""From models to physics: parameters of operators, responses, crossover, spectra, averages."""

from typing import Any

import numpy as np
from cases import case, public
from worlds import NK, loop

import skhoid
from skhoid import ARXRegressor, ControlledElement, FrequencyResponse, HumanOperator, RecursiveARX

OMEGA = np.geomspace(0.1, 30.0, 25)


@case("interpret/operator parameters")
def parameters() -> dict[str, Any]:
    batch = ARXRegressor(nk=NK, inputs=["e"]).fit(*loop("C1"))
    longer = ARXRegressor(na=3, nb=3, nk=NK - 1, inputs=["e"]).fit(*loop("C1"))
    path = RecursiveARX(nk=NK, inputs=["e"], memory_horizon=256, store_covariance=True)
    path.fit(*loop("C4"))
    values = skhoid.zoh_parameters(HumanOperator(K_e=0.07, T_L=1.2), dt=0.01)
    return {
        "batch": skhoid.operator_parameters(batch),
        "fit": skhoid.operator_parameters(batch, method="fit"),
        "fit of a longer model": skhoid.operator_parameters(longer, method="fit"),
        "fit by Padé": skhoid.operator_parameters(longer, method="fit", pade_order=3),
        "path": skhoid.operator_parameters(path),
        "arx_to_operator": skhoid.arx_to_operator(values, 0.01, np.diag([1e-4, 1e-4, 1e-6, 1e-6])),
        "reference_fits": skhoid.reference_fits(*loop("C4"), estimator=path),
        "plain reference_fits": skhoid.reference_fits(*loop("C4"), windows=["ini", "fin"]),
    }


@case("interpret/crossover")
def crossovers() -> dict[str, Any]:
    condition = skhoid.tracking_condition("C4")
    path = RecursiveARX(nk=NK, inputs=["e"], memory_horizon=256).fit(*loop("C4"))
    t = np.linspace(0.0, 80.0, 9)
    return {
        "crossover": skhoid.crossover(condition.operator, condition.controlled_element, t),
        "path": skhoid.crossover_path(path, condition.controlled_element),
    }


@case("interpret/responses")
def responses() -> dict[str, Any]:
    model = ARXRegressor(nk=NK, inputs=["e"]).fit(*loop("C1"))
    theta, P = model.coef_, model.covariance_
    arguments = {"dt": 0.02, "na": 2, "nk": NK}
    operator = FrequencyResponse.of(HumanOperator(), OMEGA)
    of_model = FrequencyResponse.of(model, OMEGA)
    loop_of = of_model * ControlledElement()
    return {
        "arx_response": public("arx_response")(theta, OMEGA, **arguments),
        "arx_response_covariance": public("arx_response_covariance")(theta, P, OMEGA, **arguments),
        "operator": operator,
        "model": of_model,
        "frame": of_model.to_frame(),
        "unwrapped": of_model.unwrapped_phase(),
        "crossover": [loop_of.crossover(), loop_of.crossover(interpolate=False)],
        "closed loop": loop_of.closed_loop(),
    }


@case("interpret/fourier coefficients")
def fourier() -> dict[str, Any]:
    target = skhoid.Multisine()
    X, y = loop("C1", 3, sampling_rate=100.0)
    found = skhoid.fourier_coefficients(X, y, forcing=target, inputs=["e"])
    response = found if isinstance(found, FrequencyResponse) else found["e"]
    disturbance, channels = target.interleaved(random_state=0), ("e", "x", "f_t", "dist")
    both = loop("C1", 2, 1, sampling_rate=100.0, disturbance=disturbance, channels=channels)
    forcing = {"f_t": target, "dist": disturbance}
    return {
        "one": response,
        "mean": response.mean(),
        "mean of coefficients": response.mean(average="coefficients"),
        "standard error": response.mean(standard_error=True),
        "one run": response.select_run(1),
        "two": skhoid.fourier_coefficients(*both, forcing=forcing, inputs=["e", "x"]),
        "auto_psd": skhoid.auto_psd(X, forcing=target),
        "plain auto_psd": skhoid.auto_psd(X),
    }


@case("data")
def data() -> dict[str, Any]:
    X, y = loop("C4", 3)
    raw = skhoid.load_human_tracking([0, 4], resample=False, channels=["f_t", "e"])
    return {
        "ensemble_average": skhoid.ensemble_average(X, y),
        "resample_runs": skhoid.resample_runs(*raw, dt=1 / 60),
        "human": skhoid.load_human_tracking(axis="y", channels=["f_t", "e"]),
        "bicycle": skhoid.load_bicycle_rider(inputs=["RollAngle", "RollRate"]),
        "run_labels": skhoid.run_labels(X),
        "sampling_time": skhoid.sampling_time(X),
        "select_runs": skhoid.select_runs(X, y, last=1),
    }


@case("data/human models")
def human() -> dict[str, Any]:
    X, y = skhoid.load_human_tracking(["difficulty 50", "difficulty 80"])
    X, y = X - X.mean(), y - y.mean()
    found = {}
    for name, model in {
        "arx": ARXRegressor(nk=7),
        "recursive": RecursiveARX(nk=7, memory_time=5.0),
        "delays": skhoid.DelaySearchCV(ARXRegressor(), range(1, 15)),
    }.items():
        model.fit(X, y)
        ahead = model.predict_ahead(X, y, horizon=6)
        found |= {f"{name}/predict": model.predict(X), f"{name}/predict_ahead": ahead}
        found[f"{name}/coef_"] = getattr(model, "coef_", None)
    return found
