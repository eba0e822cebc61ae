"""What the component is told of a model: its effects with parameters and curves, its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...effects.base import Effect
from ...effects.registry import title_of
from ...model import ModelParameter
from ...model.effect_curves import effect_curves

SPAN = 3.0  # times a value, and
SPAN_SD = 10.0  # standard errors of it, that a slider reaches on either side
STEPS = 200  # of a slider
MOST_POINTS = 200  # of a curve
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
            "name": name,
            **_numbers(one),
            "unit": one.unit,
            "meaning": one.meaning + _bound_in_words(one),
        }
        for name, one in model.parameter_table_.items()
        if "__" not in name
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


def _bound_in_words(one: ModelParameter) -> str:
    """Words for a parameter that ended at a bound: it is not estimated there."""
    return f"; at its {one.at_bound} bound" if one.at_bound else ""


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
    rows = []
    for p in effect.parameters:
        one = model.parameter_table_[f"{name}__{p.name}"]
        rows.append(
            {
                "name": one.name,
                "label": p.name.replace("_", " "),
                "meaning": p.meaning + _bound_in_words(one),
                "unit": one.unit,
                **_numbers(one),
                "low": one.min if np.isfinite(one.min) else None,
                "high": one.max if np.isfinite(one.max) else None,
                **_slider(fitted.parameter_table_[one.name]),
                "fixed": not one.free,
                "moved": one.name in moved,
            }
        )
    return rows


def _numbers(one: ModelParameter) -> dict[str, float | None]:
    return {"value": one.value, "sd": one.sd if np.isfinite(one.sd) and one.sd > 0 else None}


def _slider(one: ModelParameter) -> dict[str, float]:
    """From where to where a slider goes: round numbers about the estimate, within the bounds."""
    span = max(SPAN * abs(one.value), SPAN_SD * one.sd if np.isfinite(one.sd) else 0.0)
    if span == 0.0:
        span = (one.max - one.min) / 2 if np.isfinite(one.max - one.min) else 1.0
    begin, end = max(one.min, one.value - span), min(one.max, one.value + span)
    step = 10.0 ** np.floor(np.log10(max(end - begin, 1e-300) / STEPS))
    step *= next(k for k in (1.0, 2.0, 5.0, 10.0) if (end - begin) / (k * step) <= STEPS)
    first, last = np.ceil(begin / step) * step, np.floor(end / step) * step
    return {"from": _round(first), "to": _round(last), "step": _round(step)}


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
