"""Batch ARX models: methods, inputs, pipelines, effects."""

from typing import Any

from cases import case, model_items
from sklearn.pipeline import make_pipeline
from worlds import NK, arx, bent, loop

import skhoid
from skhoid import ARXRegressor, Decimator, DelayShift, RunInTrimmer, SimulatedARX
from skhoid.effects import Bias, DeadZone, Saturation

OPTIONS: dict[str, dict[str, Any]] = {
    "ols": {},
    "orders": {"na": 3, "nb": 4},
    "intercept": {"fit_intercept": True},
    "hac": {"covariance": "hac"},
    "iv": {"method": "iv"},
    "iv of the target": {"method": "iv", "instruments": ["f_t"]},
    "two inputs": {"inputs": ["e", "x"], "nb": [2, 1], "nk": [NK, 17]},
    "input f_t": {"inputs": ["f_t"]},
}


def fitted(options: dict[str, Any], condition: str) -> dict[str, Any]:
    X, y = loop(condition)
    model = ARXRegressor(**({"nk": NK} | options)).fit(X, y)
    other = loop(condition, 1, 7)
    found = model_items(model, *other)
    transfer = model.to_transfer_function()
    return found | {"transfer": transfer, "simulate": model.simulate(other[0])}


for _name, _options in OPTIONS.items():
    for _condition in ("C1", "C4"):
        case(f"arx/{_name}/{_condition}", options=_options, condition=_condition)(fitted)


@case("arx/miso")
def miso() -> dict[str, Any]:
    X, y = arx(n_inputs=2)
    return model_items(ARXRegressor(nk=3, inputs=["e", "motion", "x"]).fit(X, y), X, y)


@case("arx/numpy")
def of_arrays() -> dict[str, Any]:
    X, y = arx(n_runs=1)
    return model_items(
        ARXRegressor(nk=3).fit(X.to_numpy(), y.to_numpy()), X.to_numpy(), y.to_numpy()
    )


@case("arx/gaps")
def with_gaps() -> dict[str, Any]:
    X, y = (table.copy() for table in loop())
    y.iloc[100:140] = float("nan")
    keep = [i for i in range(len(y)) if not 500 <= i < 520]
    return model_items(ARXRegressor(nk=NK).fit(X.iloc[keep], y.iloc[keep]), X, y)


def piped(factor: int, delay: float, method: str, last: Any) -> dict[str, Any]:
    X, y = loop("C4", 2, keep_run_in=1.0)
    steps = (RunInTrimmer(), Decimator(factor, method=method), DelayShift(delay, inputs=["e"]))
    pipe = make_pipeline(*steps, last(inputs=["e"])).fit(X, y)
    return {"transform": pipe[:-1].transform(X), "predict": pipe.predict(X)} | model_items(pipe[-1])


for _factor, _delay, _method in [
    (2, 0.29, "ideal"),
    (4, 0.3, "ideal"),
    (2, 0.28, "aggregate"),
    (1, 0.3, "ideal"),
]:
    for _last in (ARXRegressor, skhoid.RecursiveARX):
        case(
            f"pipeline/{_last.__name__}/{_factor} {_delay} {_method}",
            factor=_factor, delay=_delay, method=_method, last=_last,
        )(piped)  # fmt: skip


def with_effects(effects: Any, shape: str) -> dict[str, Any]:
    X, y = bent(shape)
    model = SimulatedARX(nk=NK, inputs=["e"], effects=effects).fit(X, y)
    return model_items(model, *loop("C1", 1, 7))


for _name, _effects, _shape in [
    ("saturation", "saturation", "stop"),
    ("bias", Bias(), "offset"),
    ("dead zone and bias", DeadZone() + Bias(), "offset"),
    ("fixed", Saturation(limit=0.1) + Bias(level=0.0), "stop"),
]:
    case(f"greybox/arx/{_name}", effects=_effects, shape=_shape)(with_effects)
