"""A result of a search as numbers and names for JSON, and back: what a session keeps of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import pandas as pd

from ..effects.base import Effect
from ..effects.catalogue import FREE_FORMS
from ..preprocessing.gate import as_output
from ..text import Note
from .formulas import Fitted, Formula
from .results import SearchResult
from .shape import Shape
from .share import Share
from .statuses import Reason, Status, Verdict

TABLES = ("ranking", "limits", "error_path", "predictions", "unexplained", "left_out", "parameters")


def pack_result(result: SearchResult) -> dict[str, Any]:
    """All of a result but what its data say again: index and measured output."""
    simulated = result.predictions.drop(columns="measured").reset_index(drop=True)
    packed = {one.name: getattr(result, one.name) for one in fields(result)}
    return dict(json.loads(json.dumps({**packed, "predictions": simulated}, default=_plain)))


def unpack_result(packed: Mapping[str, Any], X: Any, y: Any) -> SearchResult:
    """The result that was packed, of a search on X and y; its shape has no estimator."""
    tables = {name: _table(packed[name]) for name in TABLES}
    codes = {"status": Status, "reason_code": Reason}
    tables["ranking"] = tables["ranking"].assign(
        **{name: tables["ranking"][name].map(code) for name, code in codes.items()}
    )
    predictions = tables["predictions"]
    predictions.insert(0, "measured", as_output(y))
    if isinstance(X, pd.DataFrame):
        predictions.index = X.index
    shape = packed["shape"]
    return SearchResult(
        **{
            **packed,
            **tables,
            "verdict": Verdict(packed["verdict"]),
            "closed": Share(*packed["closed"]),
            "notes": [Note(**note) for note in packed["notes"]],
            "shape": None if shape is None else _shape(shape),
        }
    )


def _plain(value: Any) -> Any:
    if isinstance(value, pd.Series):
        value = value.to_frame()
    if isinstance(value, pd.DataFrame):
        return {"units": value.attrs.get("units"), **value.to_dict("tight")}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Effect):
        return [value.name, value.get_params()]
    if is_dataclass(value):
        names = [one.name for one in fields(value) if one.name != "estimator"]
        return {name: getattr(value, name) for name in names}
    return value.item()  # of numpy


def _table(packed: Mapping[str, Any]) -> pd.DataFrame:
    table = pd.DataFrame.from_dict(dict(packed), orient="tight")
    if packed["units"]:
        table.attrs["units"] = packed["units"]
    return table


def _shape(packed: Mapping[str, Any]) -> Shape:
    (name, params), nearest, formula = (packed[k] for k in ("effect", "nearest_curve", "formula"))
    form = next(one for one in FREE_FORMS if one.name == name)
    return Shape(
        **{
            **packed,
            "estimator": None,
            "effect": form(**params),
            "curve": _table(packed["curve"]),
            "nearest": _table(packed["nearest"]),
            "nearest_curve": None if nearest is None else _table(nearest).iloc[:, 0],
            "formula": formula and Fitted(**{**formula, "formula": Formula(**formula["formula"])}),
        }
    )
