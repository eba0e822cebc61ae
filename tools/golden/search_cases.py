"""Searches of delays and orders, and the scorer."""

from typing import Any

from cases import case, model_items
from sklearn.model_selection import GridSearchCV, LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from worlds import NK, loop

import skhoid
from skhoid import ARXRegressor, Decimator, DelaySearchCV, OrderSearchCV, RecursiveARX, VAFScorer


def delays(options: dict[str, Any]) -> dict[str, Any]:
    X, y = loop("C1", 3)
    options = {"estimator": ARXRegressor(inputs=["e"])} | options
    search = DelaySearchCV(nk=range(8, 20), **options).fit(X, y)
    return model_items(search, *loop("C1", 1, 7))


for _name, _options in {
    "one_step": {},
    "one_step cv": {"cv": 3},
    "vaf": {"criterion": "vaf"},
    "vaf cv": {"criterion": "vaf", "cv": 3, "scoring": VAFScorer(run_in=5.0)},
    "recursive": {"estimator": RecursiveARX(inputs=["e"], memory_horizon=256)},
    "pipeline": {"estimator": make_pipeline(Decimator(2), ARXRegressor(inputs=["e"]))},
    "window": {"window": 30.72, "step": 10.24},
}.items():
    case(f"delays/{_name}", options=_options)(delays)


@case("delays/two inputs")
def delays_of_two() -> dict[str, Any]:
    X, y = loop("C1", 2)
    nk = [13, (13, 17), (15, 17), (15, 18)]
    search = DelaySearchCV(ARXRegressor(inputs=["e", "x"]), nk).fit(X, y)
    return model_items(search, X, y)


def orders(options: dict[str, Any]) -> dict[str, Any]:
    X, y = loop("C1", 3)
    grid = {"na": [1, 2, 3], "nb": [1, 2, 3], "nk": [NK - 1, NK], "factor": [1, 2]}
    search = OrderSearchCV(ARXRegressor(inputs=["e"]), **(grid | options)).fit(X, y)
    return model_items(search, *loop("C1", 1, 7))


for _name, _options in {
    "vaf": {},
    "best": {"rule": "best"},
    "bic": {"criterion": "bic", "factor": None},
    "mbic": {"criterion": "mbic", "penalty": 2.0, "factor": None},
}.items():
    case(f"orders/{_name}", options=_options)(orders)


@case("scores")
def scores() -> dict[str, Any]:
    X, y = loop("C4", 3)
    model = make_pipeline(Decimator(2), ARXRegressor(nk=7, inputs=["e"])).fit(X, y)
    scorers = {
        "plain": VAFScorer(),
        "run_in": VAFScorer(run_in=5.0),
        "window": VAFScorer(window=(10.0, 40.0), average="mean"),
        "rate": VAFScorer(rate="model"),
        "centered": VAFScorer(centered=True),
    }
    found: dict[str, Any] = {name: scorer(model, X, y) for name, scorer in scorers.items()}
    found["runs"] = skhoid.vaf_score(y, model.predict(X), average=None)
    cv = GridSearchCV(
        RecursiveARX(nk=NK, inputs=["e"]),
        {"memory_horizon": [64, 256]},
        scoring=VAFScorer(),
        cv=LeaveOneGroupOut(),
    ).fit(X, y, groups=skhoid.run_labels(X))
    results = {name: item for name, item in cv.cv_results_.items() if "time" not in name}
    return found | {"GridSearchCV": results}
