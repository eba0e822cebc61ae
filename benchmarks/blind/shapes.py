"""Grades of the shapes that the search offers where no name fits, and their rows in the table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from baseline import vaf
from curves import compare
from generator import Case
from sets import UNKNOWN, Right, right_shapes
from tables import quantiles, share

N_SAMPLES = 8192


@dataclass(frozen=True)
class Shape:
    """What the search says of an effect that has no name.

    Parameters
    ----------
    id, place, over : str
        Of the free form; where it acts; what the curve is a function of.
    curve : DataFrame
        Indexed by the abscissa: value, low, high.
    prediction : ndarray of shape (n_rows,)
        For X_test, by the model with the shape.
    sentence : str
        What it says in words; a path names its channel there.
    channel : str or None
        Of a path, where it is said.
    dof, gain, closed : float
        Effective degrees of freedom, points of held-out VAF, share of the gap, as it says itself.
    nearest : list of str
        Named effects, nearest first.
    recordings : list of str
        What would separate the rest.
    """

    id: str
    place: str
    over: str
    curve: pd.DataFrame
    prediction: np.ndarray
    sentence: str = ""
    channel: str | None = None
    dof: float = np.nan
    gain: float = np.nan
    closed: float = np.nan
    nearest: list[str] = field(default_factory=list)
    recordings: list[str] = field(default_factory=list)


def is_right(shape: Shape, rights: tuple[Right, ...]) -> bool:
    """Whether form, place and what it is a function of are among the right ones."""
    return any(
        shape.id == right.id
        and shape.place in right.places
        and (not right.of or _of(shape, right.of))
        for right in rights
    )


def _of(shape: Shape, wanted: frozenset[str]) -> bool:
    """A gain, delay or offset is over time or a channel; a path is over its lag, of a channel."""
    if shape.over != "lag":
        return shape.over in wanted
    if shape.channel is not None:
        return shape.channel in wanted
    # Words are asked whole: "e" is in every sentence.
    words = {word.strip(".,;:()'\"`") for word in shape.sentence.split()}
    return bool(words & wanted)


def grade_shape(case: Case, shape: Shape | None) -> dict[str, Any]:
    """``shape``: None, or its grades; ``showable``: whether some shape can be right.

    Parameters
    ----------
    case : Case
    shape : Shape or None

    Returns
    -------
    record : dict
        Ready for JSON.
    """
    names = case.truth["effects"]
    rights = right_shapes(names[0], case.truth) if len(names) == 1 else ()
    record: dict[str, Any] = {"showable": bool(rights), "shape": None}
    if shape is None:
        return record
    u = case.y_test.to_numpy().reshape(-1, N_SAMPLES)
    reached = vaf(u, np.asarray(shape.prediction, dtype=float).reshape(u.shape))
    own: dict[str, Any] = {
        "id": shape.id,
        "place": shape.place,
        "over": shape.over,
        "sentence": shape.sentence,
        "right": is_right(shape, rights),
        "vaf": reached,
        "above_ceiling": reached - case.ceiling_vaf,
        "dof": float(shape.dof),
        "gain": float(shape.gain),
        "closed_said": float(shape.closed),
        "nearest": shape.nearest[:3],
    }
    if case.gap >= 1:
        own["closed"] = (reached - case.baseline_vaf) / case.gap
    true = case.truth.get("curves", {}).get(f"{shape.id} {shape.place}")
    if true is not None and own["right"]:
        own["curve"] = compare(shape.curve, true, shape.id, shape.place)
    record["shape"] = own
    return record


def shape_rows(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Rows of the table: how often a shape is offered, and whether it is right.

    "Of the unknown" are the answers "unknown" where a gap of a point is there and some shape can
    show the effect; without a shape, such an answer counts as wrong and as closing nothing. The
    whole answer is the shape where there is one, and else the names.
    """
    rows = [("a shape offered", share(r["shape"] is not None for r in records))]
    if records[0]["suite"] not in ("left_out", "beyond"):
        return rows
    never = [r["shape"] is not None for r in records if not r["showable"]]
    rows.append(("... where none can be right", share(never)))
    unknown = [r for r in records if r["first"] == UNKNOWN and r["gap"] >= 1 and r["showable"]]
    rows.append(("... of the unknown", share(r["shape"] is not None for r in unknown)))
    right = [bool(r["shape"]) and r["shape"]["right"] for r in unknown]
    rows.append(("place right, of the unknown", share(right)))
    offered = [r["shape"] for r in unknown if r["shape"]]
    rows.append(("... of those with a shape", share(s["right"] for s in offered)))
    closed = [r["shape"]["closed"] if r["shape"] else 0.0 for r in unknown]
    if closed:
        rows.append(("gap closed by the shape, of the unknown", f"median {np.median(closed):.3f}"))
        rows.append(("... at least 0.8", share(c >= 0.8 for c in closed)))
    whole = [(r["shape"] or r)["closed"] for r in records if r["gap"] >= 1 and r["showable"]]
    if whole:
        rows.append(("gap closed by the whole answer", f"median {np.median(whole):.3f}"))
        rows.append(("... at least 0.8", share(c >= 0.8 for c in whole)))
    errors = [abs(s["closed_said"] - s["closed"]) for s in offered]
    known = [error for error in errors if np.isfinite(error)]
    rows.append(("... error of the share it says itself: median, 90 %", quantiles(known)))
    curves = [s["curve"] for s in offered if "curve" in s]
    rows.append(("bands that hold the true curve everywhere", share(c["inside"] for c in curves)))
    if curves:
        held = 100 * np.mean([c["share"] for c in curves])
        rows.append(("... share of the data where they do", f"{held:.1f} %"))
    rows.append(
        ("distance of the curve, relative: median, 90 %", quantiles(c["rms"] for c in curves))
    )
    leaks = [s["above_ceiling"] > 1 for s in offered]
    rows.append(("shapes > 1 point above the mean answer", share(leaks)))
    return rows
