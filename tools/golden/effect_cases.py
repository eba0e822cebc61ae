"""Every effect of the catalogue: its description, starts, simulation, and estimation."""

from functools import cache
from typing import Any

import numpy as np
from cases import case, errors_as_items, model_items
from scipy.signal import lfilter
from sklearn.base import clone
from worlds import CHANNELS, NK, bent, loop

import skhoid
from skhoid import OperatorRegressor, SimulatedARX
from skhoid.effects import AsymmetricGain, Bias, DeadZone, GainDrift, Saturation, catalogue, effect
from skhoid.testing import synthetic_record


@cache
def channels() -> Any:
    """Short runs of the loop with further channels that some effects need."""
    X, y = loop("C1", 2, 4, duration=24.0, run_in=10.0)
    rng = np.random.default_rng(9)
    for name in ("motion_acc", "dist", "speed"):
        noise = lfilter([0.05], [1.0, -0.95], rng.standard_normal(len(X)))
        X = X.assign(**{name: noise})
        y = y + 0.1 * noise
    return X, y


def simulated(variant: Any, record: Any) -> Any:
    """Runs of the loop with an effect at the largest of its starts that the loop bears."""
    if "channel" in variant.get_params():
        variant = variant.with_choices(channel="f_t")
    options = {"sampling_rate": 50.0, "duration": 20.0, "run_in": 5.0, "random_state": 0}
    tried: Any = None
    for size in (1.0, 0.3, 0.1, 0.03, 0.01, 0.003):
        values = {name: size * value for name, value in variant.starts(record)[-1].items()}
        values = {p.name: values.get(p.name, 0.0) for p in variant.free}
        given = variant.with_choices(**values)
        tried = errors_as_items(
            lambda given=given: skhoid.make_tracking_runs(
                "C1", 1, effects=given, remnant_intensity=0.05, channels=CHANNELS,
                disturbance=skhoid.Multisine().interleaved(random_state=0), **options,
            )
        )  # fmt: skip
        if not isinstance(tried, str):
            return tried
    return tried


def scale_of(parameter: Any) -> str:
    """What its bounds are in, as it was written when the golden file was."""
    scale = parameter.dimension if parameter.scale is None else parameter.scale
    powers = [("u", scale.u), ("e", scale.e), *scale.channels, ("T", scale.T)]
    over = "*".join(name for name, power in powers for _ in range(power))
    under = "*".join(name for name, power in powers for _ in range(-power))
    return f"{over or 1}/{under}" if under else over


def described(name: str) -> dict[str, Any]:
    known, record = effect(name), synthetic_record()
    variants = known.variants(record)
    own = known.parameters
    found = {
        "description": [known.name, known.place, known.physics, known.formula, known.source],
        "kind": [known.smooth, known.shades],
        "parameters": [[p.name, p.low, p.high, p.starts, p.meaning] for p in own],
        "units": [[p.dimension.label({"u": "{u}", "e": "{e}"}), scale_of(p)] for p in own],
        "variants": variants,
        "starts": [v.starts(record) for v in variants],
        "limits": [v.limits(record) for v in variants],
        "neutral": [v.neutral for v in variants],
    }
    runs = found["simulated"] = simulated(variants[0], record)
    delay = 0.26 if name == "wrong_delay" else None
    models = {
        "operator": (OperatorRegressor(delay, effects=name, inputs=["e"]), channels()),
        "arx": (SimulatedARX(nk=NK, effects=name, inputs=["e"]), channels()),
    }
    if not isinstance(runs, str):
        models["operator that has it"] = (clone(models["operator"][0]), runs)
    for core, (model, (X, y)) in models.items():
        fitted = errors_as_items(lambda model=model, X=X, y=y: model.fit(X, y))
        if isinstance(fitted, str):
            found[core] = fitted
        else:
            found[f"{core}/parameters_"] = fitted.parameters_
            found[f"{core}/predict"] = fitted.predict(X)
            found[f"{core}/effects_"] = getattr(fitted, "effects_", None)
    return found


for _name in catalogue().index:
    case(f"effects/{_name}", name=_name)(described)


@case("effects/catalogue")
def table() -> dict[str, Any]:
    return {"table": catalogue().drop(columns="class"), "classes": list(catalogue()["class"])}


def fitted(model: Any, shape: str | None = None, condition: str = "C1") -> dict[str, Any]:
    X, y = loop(condition) if shape is None else bent(shape, condition)
    return model_items(model.fit(X, y), *loop(condition, 1, 7))


for _name, _model, _options in [
    ("plain", OperatorRegressor(inputs=["e"]), {}),
    ("plain C2", OperatorRegressor(), {"condition": "C2"}),
    ("given delay", OperatorRegressor(delay=0.28, settling=0.0), {}),
    ("element", OperatorRegressor(controlled_element=skhoid.ControlledElement()), {}),
    ("saturation", OperatorRegressor(effects="saturation"), {"shape": "stop"}),
    ("two", OperatorRegressor(effects=DeadZone() + Bias()), {"shape": "offset"}),
    ("three", OperatorRegressor(effects=["bias", "asym_gain", "gain_drift"]), {"shape": "offset"}),
    (
        "fixed",
        OperatorRegressor(effects=Saturation(limit=0.1) + AsymmetricGain(asymmetry=0.0)),
        {"shape": "stop"},
    ),
    ("change", OperatorRegressor(effects="tv_gain"), {"condition": "C4"}),
    ("with_effect", OperatorRegressor().with_effect("bias").with_effect(GainDrift()), {}),
]:
    case(f"greybox/operator/{_name}", model=_model, **_options)(fitted)


@case("greybox/operator/human recording")
def recording() -> dict[str, Any]:
    X, y = skhoid.load_human_tracking(["difficulty 80"], channels=["f_t", "e"])
    X, y = X - X.mean(), y - y.mean()
    return model_items(OperatorRegressor(inputs=["f_t"]).fit(X, y), X, y)


@case("greybox/operator/bicycle")
def bicycle() -> dict[str, Any]:
    X, y = skhoid.load_bicycle_rider(inputs=["RollAngle", "RollRate"])
    X, y = X.iloc[:4000], y.iloc[:4000]
    return model_items(OperatorRegressor(inputs=["RollAngle"]).fit(X, y), X, y)
