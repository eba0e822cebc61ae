"""Models against measurements: compare, remnant, scores, checks of channels, searched effects."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd
from cases import case, result_items
from scipy.signal import lfilter
from worlds import NK, arx, bent, loop

import skhoid
from skhoid import ARXRegressor, EffectSearchCV, OperatorRegressor, RecursiveARX


def compared(model: Any, data: Callable[[], Any], **options: Any) -> dict[str, Any]:
    X, y = data()
    first, last = (skhoid.select_runs(X, y, **part) for part in ({"first": 2}, {"last": 2}))
    model.fit(*first)
    comparison = skhoid.compare(model, *last, **options)
    return result_items(comparison) | {"repr": repr(comparison)}


@cache
def recordings(name: str) -> Any:
    if name == "bicycle":
        inputs = ["RollAngle", "RollRate", "YawRate", "PullForce"]
        X, y = skhoid.load_bicycle_rider(inputs=inputs, correct_units=False)
        return X.iloc[:6000], y.iloc[:6000]
    X, y = skhoid.load_human_tracking([f"phase-size 2{k}" for k in "bcde"])
    return X - X["f_t"].mean(), y - X["f_t"].mean()


def other_phases() -> Any:
    """Runs that repeat no target, so that the ceiling comes from between its lines."""
    return loop("C1", 4, 2, random_phases=True)


for _name, _model, _data, _options in [
    ("C1", ARXRegressor(nk=NK, inputs=["e"]), partial(loop, "C1", 4), {}),
    ("C4", ARXRegressor(nk=NK, inputs=["e"]), partial(loop, "C4", 4), {"run_in": 5.0}),
    ("recursive", RecursiveARX(nk=NK, inputs=["e"]), partial(loop, "C4", 4), {}),
    ("operator", OperatorRegressor(), partial(bent, "stop", n_runs=4), {"false_alarm": 0.05}),
    ("lines", ARXRegressor(nk=12, inputs=["e"]), other_phases, {}),
    ("bent", ARXRegressor(nk=NK, inputs=["e"]), partial(bent, "squared", n_runs=4), {}),
    ("no repeats", ARXRegressor(nk=NK, inputs=["e"]), partial(loop, "C1", 4), {"repeats": False}),
    ("one input", ARXRegressor(nk=3, inputs=["e"]), partial(arx, 4, 1500, 2), {}),
    ("human", ARXRegressor(inputs=["f_t"]), partial(recordings, "human"), {}),
]:
    case(f"compare/{_name}", model=_model, data=_data, **_options)(compared)


@case("compare/estimation")
def with_estimation() -> dict[str, Any]:
    X, y = loop("C1", 4)
    first, last = (skhoid.select_runs(X, y, **part) for part in ({"first": 2}, {"last": 2}))
    model = ARXRegressor(nk=NK, na=6, nb=8, inputs=["e"]).fit(*first)
    return result_items(skhoid.compare(model, *last, estimation=first))


@case("compare/bicycle")
def of_bicycle() -> dict[str, Any]:
    X, y = recordings("bicycle")
    model = ARXRegressor(inputs=["RollAngle"]).fit(X, y)
    return result_items(skhoid.compare(model, X, y, roles={"PullForce": "dist"}))


def remnant(data: Callable[[], Any], **options: Any) -> dict[str, Any]:
    X, y = data()
    model = ARXRegressor(nk=NK, inputs=["e"]).fit(X, y)
    return result_items(skhoid.remnant_estimate(model, X, y, **options))


for _order in (1, 2, 4):
    case(f"remnant/order {_order}", data=partial(loop, "C1", 4, remnant_order=_order))(remnant)
case("remnant/lines", data=other_phases, repeats=False)(remnant)
case("remnant/two runs", data=partial(loop, "C2", 2), run_in=10.0)(remnant)


@case("performance scores")
def scores() -> dict[str, Any]:
    found: dict[str, Any] = {c: skhoid.performance_scores(*loop(c, 2)) for c in ("C1", "C4")}
    windows = {"early": (0.0, 20.0), "late": (60.0, 80.0)}
    found["own windows"] = skhoid.performance_scores(*loop("C3", 2), windows=windows)
    found["change"] = skhoid.performance_scores(*loop("C3", 2), change=40.96)
    return found


@case("check channels/simulated")
def channels() -> dict[str, Any]:
    X, y = (table.copy() for table in loop("C1", 2))
    rate = np.gradient(X["x"].to_numpy(), 0.02)
    faults = {
        "none": (X, y),
        "rate unit": (X.assign(x_rate=rate * np.pi / 180), y),
        "rate gain": (X.assign(x_rate=1.3 * rate), y),
        "copy": (X.assign(again=X["e"]), y),
        "late copy": (X.assign(again=X["x"].shift(5).fillna(0.0)), y),
        "constant": (X.assign(still=1.0), y),
        "held": (X.assign(x=X["x"].iloc[::4].reindex(X.index).ffill()), y),
        "clipped": (X.assign(e=X["e"].clip(-0.3, 0.3)), y),
        "sign": (X.assign(e=-X["e"]), y),
        "first samples": (X.assign(e=np.r_[np.zeros(60), X["e"].to_numpy()[60:]]), y),
        "NaN": (X.mask(X["e"].abs() > 1.5), y),
        "copy of the output": (X.assign(again=y), y),
    }
    return {name: skhoid.check_channels(*data) for name, data in faults.items()}


@case("check channels/recorded")
def recorded() -> dict[str, Any]:
    inputs = ["RollAngle", "RollRate", "YawRate", "PitchRate", "RearWheelRate", "SteerAngle"]
    wrong = skhoid.load_bicycle_rider(inputs=inputs, correct_units=False, output="SteerTorque")
    return {
        "human": skhoid.check_channels(*skhoid.load_human_tracking(channels=["f_t", "e"])),
        "bicycle": skhoid.check_channels(*wrong),
    }


def driven(inner: Any = None, outer: Any = None, n_runs: int = 3, seed: int = 0) -> Any:
    """Runs in open loop of a second-order system behind a delay, with something hidden in it."""
    rng = np.random.default_rng(seed)
    t = np.arange(1000) * 0.02
    omega = 2 * np.pi * np.array([0.05, 0.11, 0.19, 0.31, 0.47, 0.71, 1.03, 1.51, 2.2])
    tables = []
    for run in range(n_runs):
        phase = rng.uniform(0, 2 * np.pi, omega.size)
        e = (np.sin(np.multiply.outer(t, omega) + phase) / (1 + omega / 3)).sum(axis=1)
        answered = e if inner is None else inner(e)
        u = lfilter([0.0] * 12 + [0.1, -0.09], [1.0, -1.83, 0.85], answered)
        n = lfilter([1.0], [1.0, -0.75], rng.standard_normal(t.size))
        u = u + 0.25 * np.std(u) * n / np.std(n)
        u = u if outer is None else outer(u)
        index = pd.MultiIndex.from_arrays([np.full(t.size, run + 1), t.round(9)])
        index.names = ["run", "time"]
        tables.append(pd.DataFrame({"e": e, "u": u}, index=index))
    table = pd.concat(tables)
    return table[["e"]], table["u"]


FEW = ["dead_zone", "asym_gain", "saturation", "bias", "gain_drift", "lapses"]


def searched(search: Any, data: Callable[[], Any]) -> dict[str, Any]:
    X, y = data()
    search.fit(X, y)
    names = [name for name in dir(search) if name.endswith("_") and not name.startswith("_")]
    models = {"baseline_", "best_estimator_"}
    found = {name: getattr(search, name) for name in names if name not in models}
    found |= {f"{model}/parameters_": getattr(search, model).parameters_ for model in models}
    return found | {
        "predict": search.predict(X),
        "baseline": search.baseline_.predict(X),
        "score": search.score(X, y),
        "summary()": search.summary(),
    }


OPERATOR, ARX = OperatorRegressor(), ARXRegressor(nk=12)
for _name, _search, _world in [
    ("dead zone", EffectSearchCV(OPERATOR, FEW), {"inner": lambda e: e - e.clip(-0.3, 0.3)}),
    ("nothing", EffectSearchCV(OPERATOR, FEW), {}),
    ("relay", EffectSearchCV(OPERATOR, ["bias", "gain_drift", "lapses"]), {"inner": np.sign}),
    ("stop, arx", EffectSearchCV(ARX, FEW), {"outer": lambda u: u.clip(-0.3, 0.3)}),
    ("nothing, arx", EffectSearchCV(ARX, ["bias", "dead_zone"]), {}),
    (
        "two",
        EffectSearchCV(OPERATOR, ["dead_zone", "bias", "asym_gain"]),
        {"inner": lambda e: e - e.clip(-0.3, 0.3), "outer": lambda u: u + 0.25},
    ),
    (
        "weak",
        EffectSearchCV(OPERATOR, ["dead_zone", "cubic_gain", "extra_lag"]),
        {"inner": lambda e: e + 0.041 * e**3, "n_runs": 2},
    ),
    (
        "alike",
        EffectSearchCV(OPERATOR, ["dead_zone", "cubic_gain", "saturation", "hardening_stiffness"]),
        {"inner": np.tanh, "n_runs": 2},
    ),
    ("all", EffectSearchCV(OPERATOR), {"outer": lambda u: 0.6 * np.round(u / 0.6), "n_runs": 2}),
    (
        "all, arx",
        EffectSearchCV(ARX, max_effects=1),
        {"outer": lambda u: u.clip(-0.3, 0.3), "n_runs": 2},
    ),
    ("one run", EffectSearchCV(OPERATOR, ["bias", "drift"]), {"n_runs": 1}),
    (
        "cut short",
        EffectSearchCV(OPERATOR, ["dead_zone"], max_effects=0),
        {"inner": lambda e: e - e.clip(-0.3, 0.3)},
    ),
]:
    case(f"effect search/{_name}", search=_search, data=partial(driven, **_world))(searched)

case(
    "effect search/closed loop",
    search=EffectSearchCV(
        OperatorRegressor(inputs=["e"]),
        ["saturation", "feedforward", "output_feedback", "preview", "wrong_delay"],
        cv=2,
        display="pursuit",
        controlled_element=skhoid.ControlledElement(),
    ),
    data=partial(bent, "stop", n_runs=2, duration=30.0, run_in=10.0),
)(searched)
