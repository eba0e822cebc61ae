"""The register of cases, and how their results become items. Every other file adds cases."""

import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from digests import digested, learned, parts

CASES: dict[str, Callable[[], dict[str, Any]]] = {}
HOMES = (
    "skhoid",
    "skhoid.lab.experiment",
    "skhoid.lab.studies",
    "skhoid.interpret",
    "skhoid.plotting",
)


def case(name: str, /, **options: Any) -> Callable[[Callable], Callable]:
    """Register a function that returns ``{item: value}`` under a name, called with options."""

    def registered(function: Callable) -> Callable:
        if name in CASES:
            raise ValueError(f"Two cases are called {name!r}.")
        CASES[name] = lambda: function(**options)
        return function

    return registered


def public(name: str) -> Any:
    """A public object, wherever it lives."""
    for home in HOMES:
        if find_spec(home) is not None and hasattr(module := import_module(home), name):
            return getattr(module, name)
    raise ImportError(f"No module of {', '.join(HOMES)} has {name!r}.")


def model_items(model: Any, X: Any = None, y: Any = None, horizon: int = 5) -> dict[str, Any]:
    """Everything that a fitted model shows: attributes, predictions, score and summary."""
    found = {name: value for name, value in learned(model).items() if value is not None}
    if X is not None:
        found["predict"] = model.predict(X)
        found["score"] = model.score(X, y)
        if hasattr(model, "predict_ahead"):
            found["predict_ahead"] = model.predict_ahead(X, y, horizon=horizon)
    return found | summary_items(model)


def result_items(result: Any) -> dict[str, Any]:
    """All public attributes of a result, and its summary."""
    return dict(sorted(parts(result).items())) | summary_items(result)


def summary_items(result: Any) -> dict[str, Any]:
    return {"summary()": result.summary()} if callable(getattr(result, "summary", None)) else {}


def errors_as_items(function: Callable[[], Any]) -> Any:
    """The result, or the message where the package refuses."""
    try:
        return function()
    except (ValueError, TypeError, ArithmeticError) as error:
        return f"refused: {error}"


def items_of(name: str) -> Iterator[tuple[str, list[str]]]:
    """Compute a case: names of items, each with checksum and plain numbers."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = CASES[name]()
    ours = [w for w in caught if type(w.message).__module__.startswith("skhoid")]
    if ours:
        found["warnings"] = [f"warning: {w.message}" for w in ours]
    for item, value in found.items():
        for group, stored in digested(value).items():
            yield f"{group}/{name}/{item}", stored
