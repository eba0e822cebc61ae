"""Hold the headline numbers of the package against a file that a person can review.

    python tools/golden.py               # compute all again and compare
    python tools/golden.py --only search # one topic
    python tools/golden.py --write       # store what is found

``golden.csv`` has one line a number: its name, its value, and how far it may be off relative to its
size. Linear algebra is held to 1e-8, what an optimiser ends at to 1e-3; texts have to be the same.
"""

import argparse
import csv
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from threadpoolctl import threadpool_limits

import skhoid
from skhoid import ARXRegressor, OperatorRegressor, RecursiveARX
from skhoid import effects as fx

STORED = Path(__file__).with_suffix(".csv")
EXACT, FITTED = 1e-8, 1e-3  # relative: sums in another order; flat minima on another processor
NK = 15  # samples at 50 Hz: a delay of 0.28 s and the zero-order hold

Numbers = Iterator[tuple[str, Any]]
TOPICS: dict[str, tuple[Callable[[], Numbers], float]] = {}


def topic(tolerance: float) -> Callable[[Callable[[], Numbers]], Callable[[], Numbers]]:
    def add(function: Callable[[], Numbers]) -> Callable[[], Numbers]:
        TOPICS[function.__name__] = function, tolerance
        return function

    return add


@cache
def loop(condition: str = "C1", n_runs: int = 3, seed: int = 0, **options: Any) -> Any:
    given = {"remnant_intensity": 0.1, "sampling_rate": 50.0, "channels": ("e", "x", "f_t")}
    return skhoid.make_tracking_runs(condition, n_runs, random_state=seed, **given | options)


def of(prefix: str, values: Any, names: Any = None) -> Numbers:
    """Several numbers under one name each."""
    values = np.asarray(values, float).ravel()
    names = range(values.size) if names is None else names
    yield from ((f"{prefix}/{name}", value) for name, value in zip(names, values, strict=True))


@topic(EXACT)
def simulation() -> Numbers:
    for condition in ("C1", "C2", "C3", "C4", "C5", "C6"):
        X, y = loop(condition, 1, 5, remnant_intensity=0.15)
        yield f"{condition}/std of e", X["e"].std()
        yield f"{condition}/std of u", y.std()
    for order in (1, 4, "nm"):
        yield f"remnant of order {order}/std of u", loop("C1", 1, 5, remnant_order=order)[1].std()
    own = skhoid.HumanOperator(K_t=0.03, K_x=0.02, K_xdot=0.01)
    yield "pursuit/std of u", loop("C1", 1, 5, display="pursuit", operator=own)[1].std()
    yield (
        "disturbed/std of u",
        loop("C1", 1, disturbance=skhoid.Multisine().interleaved(random_state=0))[1].std(),
    )


@topic(EXACT)
def effects() -> Numbers:
    """Each of the catalogue at values that a card shows: what it does to a loop."""
    known = [skhoid.effects.effect(name) for name in skhoid.effects.catalogue().index]
    shown = [one.with_choices(**arguments) for one in known for arguments in one.examples]
    for number, effect in enumerate(shown):
        form = getattr(effect, "form", None) or getattr(effect, "trigger", None) or number
        try:
            y = loop("C1", 1, 0, effects=effect)[1]
        except (ValueError, RuntimeError) as error:  # not for a simulated person
            yield f"{effect.name}/{form}", type(error).__name__
        else:
            yield f"{effect.name}/{form}", y.std()


@topic(EXACT)
def arx() -> Numbers:
    X, y = loop("C1")
    model = ARXRegressor(nk=NK, inputs=["e"]).fit(X, y)
    yield from of("coef", model.coef_)
    yield from of("standard error", np.sqrt(np.diag(model.covariance_)))
    yield "VAF", skhoid.vaf_score(y, model.predict(X))
    others, measured = loop("C1", 2, 7)
    yield "VAF of others", skhoid.vaf_score(measured, model.predict(others))
    ahead = model.predict_ahead(X, y, horizon=3)
    yield "RMSE 3 ahead", np.sqrt(np.nanmean((y.to_numpy() - ahead) ** 2))
    two = ARXRegressor(na=2, nb=(2, 1), nk=(NK, 3), inputs=["e", "x"]).fit(X, y)
    yield from of("two inputs/coef", two.coef_)
    missing = y.mask(np.arange(len(y)) % 50 < 5)
    yield from of("missing outputs/coef", ARXRegressor(nk=NK, inputs=["e"]).fit(X, missing).coef_)
    instruments = ARXRegressor(nk=NK, inputs=["e"], method="iv").fit(X, y)
    yield from of("instruments/coef", instruments.coef_)


@topic(EXACT)
def recursion() -> Numbers:
    X, y = loop("C4", 2)
    for name, setting in {
        "all alike": {},
        "forgetting": {"forgetting": 0.995},
        "horizon": {"memory_horizon": 256},
        "time": {"memory_time": 5.0},
        "by parameter": {"forgetting": [0.99, 0.999, 0.995, 0.998]},
        "p0": {"memory_horizon": 256, "p0": 1e4},
    }.items():
        model = RecursiveARX(nk=NK, inputs=["e"], **setting).fit(X, y)
        yield from of(f"{name}/coef", model.coef_)
        yield f"{name}/VAF", skhoid.vaf_score(y, model.predict(X))
    stream = RecursiveARX(nk=NK, inputs=["e"], memory_horizon=256)
    X, y = loop("C4", 1)
    for start in range(0, len(X), 500):
        stream.partial_fit(X.iloc[start : start + 500], y.iloc[start : start + 500])
    yield from of("stream/coef", stream.coef_)


@topic(EXACT)
def delays_and_orders() -> Numbers:
    X, y = loop("C1")
    for criterion in ("one_step", "vaf"):
        search = skhoid.DelaySearchCV(ARXRegressor(inputs=["e"]), range(8, 20), criterion=criterion)
        search.fit(X, y)
        yield f"{criterion}/best nk", search.best_nk_
        yield f"{criterion}/best delay", search.best_delay_
        yield f"{criterion}/loss", np.min(search.loss_)
    grid = {"na": [1, 2, 3], "nb": [1, 2, 3], "nk": [NK - 1, NK], "factor": [1, 2]}
    orders = skhoid.OrderSearchCV(ARXRegressor(inputs=["e"]), **grid).fit(X, y)
    yield from orders.best_params_.items()
    pipe = make_pipeline(
        skhoid.Decimator(), skhoid.DelayShift(delay=0.28), RecursiveARX(nk=1, inputs=["e"])
    )
    params = {"decimator__factor": [1, 2], "recursivearx__memory_horizon": [64, 256]}
    cv = GridSearchCV(pipe, params, scoring=skhoid.VAFScorer(), cv=LeaveOneGroupOut())
    cv.fit(X, y, groups=skhoid.run_labels(X))
    yield from of("grid/VAF", cv.cv_results_["mean_test_score"])


@topic(FITTED)
def model() -> Numbers:
    for name, (regressor, data) in {
        "plain": (OperatorRegressor(), loop("C1")),
        "C2": (OperatorRegressor(), loop("C2")),
        "given delay": (OperatorRegressor(delay=0.28), loop("C1")),
        "three": (
            OperatorRegressor(effects=["bias", "dead_zone", "asym_gain"]),
            loop("C1", effects=fx.DeadZone(width=0.3) + fx.Bias(level=0.05)),
        ),
        "change": (OperatorRegressor(effects="tv_gain"), loop("C4")),
        "arx with a bias": (ARXRegressor(nk=NK, inputs=["e"]).with_effect("bias"), loop("C1")),
    }.items():
        regressor = regressor.fit(*data)
        table = regressor.parameters_
        yield from of(f"{name}/value", table["value"], table.index)
        yield f"{name}/VAF", regressor.score(*data)
    sd = OperatorRegressor().fit(*loop("C1")).parameters_["sd"]
    yield from of("plain/standard error", sd, sd.index)


@topic(FITTED)
def comparison() -> Numbers:
    for name, regressor, data in [
        ("arx", ARXRegressor(nk=NK, inputs=["e"]), loop("C1", 4)),
        ("operator", OperatorRegressor(), loop("C1", 4, 1, effects=fx.Saturation(limit=0.15))),
        ("changing", ARXRegressor(nk=NK, inputs=["e"]), loop("C4", 4)),
    ]:
        found = skhoid.compare(regressor.fit(*data), *data)
        yield f"{name}/VAF", found.vaf
        yield f"{name}/noise ceiling", found.noise_ceiling
        yield f"{name}/explainable gap", found.explainable_gap
        yield f"{name}/findings", " ".join(finding.name for finding in found.findings)


@topic(FITTED)
def search() -> Numbers:
    few = ["dead_zone", "asym_gain", "saturation", "bias", "gain_drift", "lapses"]
    for name, estimator, hidden in [
        ("nothing", OperatorRegressor(), None),
        ("two", OperatorRegressor(), fx.DeadZone(width=0.3) + fx.Bias(level=0.05)),
        ("not tried", OperatorRegressor(), fx.Backlash(gap=0.1)),
        ("arx", ARXRegressor(nk=NK), fx.Saturation(limit=0.15)),
    ]:
        X, y = loop("C1", 3, 2, **({} if hidden is None else {"effects": hidden}))
        found = skhoid.EffectSearchCV(estimator, few).fit(X, y)
        yield f"{name}/named", " ".join(found.best_effects_)
        yield f"{name}/verdict", str(found.verdict_)
        yield from of(f"{name}/held-out VAF", found.error_path_["vaf"])
        if not found.best_effects_:
            continue  # what comes first by chance
        first = found.ranking_.iloc[0]
        yield f"{name}/first", first["effect"]
        yield f"{name}/first/gain", first["vaf_gain"]
        yield f"{name}/first/delta BIC", first["delta_bic"]


@topic(FITTED)
def tracking() -> Numbers:
    X, y = loop("C4", 1, 3)
    for name, method in {
        "box_jenkins": skhoid.RecursiveBoxJenkins(nk=NK, inputs=["e"], memory_time=6.4),
        "iv": skhoid.RecursiveIV(nk=NK, inputs=["e"], memory_time=6.4),
        "fir": skhoid.RecursiveFIR(inputs=["e"]),
        "bank": skhoid.DelayBankARX(inputs=["e"]),
        "kalman": skhoid.OperatorKalman(inputs=["e"]),
        "windowed": skhoid.WindowedOperator(inputs=["e"]),
        "sigmoid": skhoid.SigmoidOperator(inputs=["e"]),
    }.items():
        yield f"{name}/VAF", skhoid.vaf_score(y, method.fit(X, y).predict(X))


@topic(FITTED)
def interpret() -> Numbers:
    batch = ARXRegressor(nk=NK, inputs=["e"]).fit(*loop("C1"))
    found = skhoid.operator_parameters(batch).iloc[-1]
    yield from of("operator", found, found.index)
    path = RecursiveARX(nk=NK, inputs=["e"], memory_horizon=256).fit(*loop("C4"))
    yield "path/K_e at the end", skhoid.operator_parameters(path)["K_e"].iloc[-1]
    response = skhoid.FrequencyResponse.of(batch, [0.5, 2.0, 8.0])
    yield from of("response/magnitude", np.ravel(response.magnitude))
    condition = skhoid.tracking_condition("C4")
    crossed = skhoid.crossover(condition.operator, condition.controlled_element, [0.0, 80.0])
    yield from of("crossover", pd.DataFrame(crossed).to_numpy())


@topic(FITTED)
def people() -> Numbers:
    given = {"sampling_rate": 50.0, "random_state": 0}
    X, y = skhoid.simulate_experiment(2, ["C1", "C4"], 3, **given)
    yield "std of u", y.std()
    yield "RMS of e", np.sqrt(np.mean(X["e"] ** 2))
    table = skhoid.identify_people(ARXRegressor(nk=NK, inputs=["e"]), X, y, ceiling=False).groups
    for name, values in table.groupby("parameter")["estimate"]:
        yield name, values.mean()


@topic(EXACT)
def recordings() -> Numbers:
    for name, load in {
        "tracking": skhoid.load_human_tracking,
        "bicycle": skhoid.load_bicycle_rider,
    }.items():
        X, y = load()
        yield f"{name}/rows", len(X)
        yield f"{name}/std of u", y.std()


def computed(only: str) -> dict[str, tuple[Any, float]]:
    """All numbers of the chosen topics, and how far each may be off."""
    found = {}
    for name, (function, tolerance) in TOPICS.items():
        if name.startswith(only):
            begun = time.perf_counter()
            found |= {f"{name}/{item}": (value, tolerance) for item, value in function()}
            print(f"{time.perf_counter() - begun:5.1f} s  {name}", flush=True)
    return found


def agrees(stored: str, value: Any, tolerance: float) -> bool:
    """Whether a value is the stored one: text to the letter, numbers within the tolerance."""
    if isinstance(value, str):
        return stored == value
    return bool(np.isclose(float(value), float(stored), rtol=tolerance, atol=0.0, equal_nan=True))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="store what is found")
    parser.add_argument("--only", default="", metavar="TOPIC", help="topics whose name begins so")
    options = parser.parse_args()
    rows = []
    if STORED.exists():
        with STORED.open(newline="") as file:
            rows = list(csv.reader(file))[1:]
    stored = {name: (value, float(tolerance)) for name, value, tolerance in rows}
    with threadpool_limits(1):
        found = computed(options.only)
    if options.write:
        kept = {n: v for n, v in stored.items() if not n.startswith(options.only)}
        texts = {
            n: (v if isinstance(v, str) else f"{float(v):.10g}", t) for n, (v, t) in found.items()
        }
        with STORED.open("w", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(["name", "value", "relative tolerance"])
            table.writerows([n, *value] for n, value in (kept | texts).items())
        return 0
    wanted = {n for n in stored if n.startswith(options.only)}
    failed = sorted(wanted ^ found.keys())
    for name in failed:
        print(f"{name}: {'is not stored' if name in found else 'is not found'}")
    for name in sorted(wanted & found.keys()):
        value, tolerance = stored[name]
        if not agrees(value, found[name][0], tolerance):
            print(f"{name}: stored {value}, found {found[name][0]}")
            failed.append(name)
    print(f"{len(found)} numbers, {len(failed)} differ")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
