"""What plots of a search for effects share: what they take from it, colours and names of its steps.

Open it when ``EffectSearchCV`` gets another attribute to draw, or steps another look.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sklearn.exceptions import NotFittedError

from ..search import with_effects
from ._roles import greyed

BASELINE = "baseline"
UNKNOWN = "unknown"
PALEST = 0.35  # share of the colour, of the baseline; the rest is grey


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


def step_colours(n_steps: int, colour: str) -> list[str]:
    """Shades of a colour, the greyest of the baseline: the last step has the colour itself."""
    if n_steps == 1:
        return [colour]
    shares = [PALEST + (1.0 - PALEST) * i / (n_steps - 1) for i in range(n_steps)]
    return [greyed(colour, share) for share in shares]


def step_labels(effects: Iterable[str]) -> list[str]:
    """Names of the models: the baseline, and with all effects that each step has by then."""
    added = [name for name in effects if name != BASELINE]
    return [with_effects(added[:n]) for n in range(len(added) + 1)]
