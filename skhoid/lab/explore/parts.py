"""What the component is told of a model: its effects with parameters and curves, its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...effects.base import Effect
from ...effects.registry import title_of
from ...model.effect_curves import effect_curves
from ...model.model import AT_BOUND

SPAN = 3.0  # times a value, and
SPAN_SD = 10.0  # standard errors of it, that a slider reaches on either side
STEPS = 200  # of a slider
MOST_POINTS = 200  # of a curve
BOUNDS = ("lower", "upper")
TINY = 1e-300
DIGITS = 12  # of what a slider is set to


def effects_of(
    model: Any, moved: Mapping[str, float], fitted: Any, domain: str
) -> list[dict[str, Any]]:
    """The effects of a model as cards; ``fitted`` is the same before anything was moved."""
    return [
        {
            "name": name,
            "title": title_of(name),
            "words": effect.physics_in(domain),
            "form": _form(effect),
            "parameters": _parameters(name, effect, model, moved, fitted),
            "curve": curve_of(model, name),
        }
        for name, effect in dict(model.effects_.steps).items()
    ]


def others_of(model: Any) -> list[dict[str, Any]]:
    """The parameters that are not of an effect, as numbers."""
    return [
        {
            "name": str(name),
            **_numbers(row),
            "unit": row["unit"],
            "meaning": row["meaning"] + at_bound(model, str(name), float(row["value"])),
        }
        for name, row in model.parameters_.iterrows()
        if "__" not in str(name)
    ]


def curve_of(model: Any, name: str) -> dict[str, Any] | None:
    """What an effect does, as lines; None where it cannot be drawn."""
    try:
        with np.errstate(all="ignore"):
            found = effect_curves(model, name)
    except (ValueError, FloatingPointError):
        return None
    lines = [
        {"label": label, "x": _thinned(curve.x), "y": _thinned(curve.y)}
        for label, curve in found.curves.items()
    ]
    without = {"x": _thinned(found.without.x), "y": _thinned(found.without.y)}
    return {"xlabel": found.xlabel, "ylabel": found.ylabel, "lines": lines, "without": without}


def at_bound(model: Any, name: str, value: float) -> str:
    """Words for a parameter that ended at a bound: it is not estimated there."""
    for bound, words in zip(model._simulation.bounds.get(name, ()), BOUNDS, strict=False):
        if np.isfinite(bound) and abs(value - bound) <= AT_BOUND * max(abs(bound), TINY):
            return f"; at its {words} bound"
    return ""


def _thinned(values: Any) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    rows = np.unique(np.linspace(0, values.size - 1, min(values.size, MOST_POINTS)).astype(int))
    return values[rows]


def _form(effect: Effect) -> str:
    return ", ".join(str(v) for key in effect.choices if (v := getattr(effect, key)) is not None)


def _parameters(
    name: str, effect: Effect, model: Any, moved: Mapping[str, float], fitted: Any
) -> list[dict[str, Any]]:
    if effect.free_form:
        return []  # coefficients of a curve
    spec = dict(model._simulation.effects.steps)[name]
    rows = []
    for p in effect.parameters:
        full = f"{name}__{p.name}"
        row = model.parameters_.loc[full]
        low, high = (float(bound) for bound in model._simulation.bounds[full])
        rows.append(
            {
                "name": full,
                "label": p.name.replace("_", " "),
                "meaning": p.meaning + at_bound(model, full, float(row["value"])),
                "unit": row["unit"],
                **_numbers(row),
                "low": low if np.isfinite(low) else None,
                "high": high if np.isfinite(high) else None,
                **_slider(fitted.parameters_.loc[full], low, high),
                "fixed": p.name in spec.fixed,
                "moved": full in moved,
            }
        )
    return rows


def _numbers(row: Any) -> dict[str, float | None]:
    sd = float(row["sd"])
    return {"value": float(row["value"]), "sd": sd if np.isfinite(sd) and sd > 0 else None}


def _slider(row: Any, low: float, high: float) -> dict[str, float]:
    """From where to where a slider goes: round numbers about the estimate, within the bounds."""
    value, sd = float(row["value"]), float(row["sd"])
    span = max(SPAN * abs(value), SPAN_SD * sd if np.isfinite(sd) else 0.0)
    if span == 0.0:
        span = (high - low) / 2 if np.isfinite(high - low) else 1.0
    begin, end = max(low, value - span), min(high, value + span)
    step = 10.0 ** np.floor(np.log10(max(end - begin, 1e-300) / STEPS))
    step *= next(k for k in (1.0, 2.0, 5.0, 10.0) if (end - begin) / (k * step) <= STEPS)
    first, last = np.ceil(begin / step) * step, np.floor(end / step) * step
    return {"from": _round(first), "to": _round(last), "step": _round(step)}


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
