"""What plots of a search for effects share: what they take from it, colours and names of its steps.

Open it when ``EffectSearchCV`` gets another attribute to draw, or steps another look.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sklearn.exceptions import NotFittedError

from ._roles import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

BASELINE = "baseline"
UNKNOWN = "unknown"
BEFORE = VERMILION
AFTER = BLUE
BETWEEN = (GREEN, PURPLE, ORANGE, SKY)
LONG = 12  # letters in one line below an axis


def attributes_of(search: Any, names: Iterable[str], display: str) -> dict[str, Any]:
    """Fitted attributes of a search, without their underscores; refuse anything that has none."""
    names = list(names)
    missing = [name for name in names if not hasattr(search, name)]
    if not missing:
        return {name.rstrip("_"): getattr(search, name) for name in names}
    if type(search).__name__ == "EffectSearchCV":
        raise NotFittedError(
            f"This EffectSearchCV is not fitted yet. Call fit(X, y) before {display}."
        )
    raise TypeError(
        f"{display}.from_estimator draws a fitted EffectSearchCV; got {type(search).__name__}, "
        f"which has no {missing[0]}."
    )


def unit_of(predictions: Any) -> str | None:
    """Unit of the output in a table of predictions."""
    return predictions.attrs.get("units", {}).get("measured")


def step_colours(n_steps: int) -> list[str]:
    """Colours of the baseline, of what lies between, and of the last step."""
    if n_steps == 1:
        return [AFTER]
    return [BEFORE, *(BETWEEN[i % len(BETWEEN)] for i in range(n_steps - 2)), AFTER]


def step_labels(effects: Iterable[str]) -> list[str]:
    """Names of the steps: the baseline, and what each adds."""
    return [name if name == BASELINE else f"+ {name}" for name in effects]


def broken(label: str) -> str:
    """A long id in two lines, broken at the underscore nearest to its middle."""
    if len(label) <= LONG or "_" not in label:
        return label
    places = [i for i, letter in enumerate(label) if letter == "_"]
    middle = min(places, key=lambda i: abs(i - len(label) / 2))
    return f"{label[: middle + 1]}\n{label[middle + 1 :]}"
