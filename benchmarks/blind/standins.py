"""Stand-ins for the search that check the trial itself; each is a function of a case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from curves import TrueCurve
from generator import Case
from scorer import Answer
from sets import UNKNOWN, right_shapes
from shapes import Shape

HALF_BAND = 0.02  # of the range of the true curve


def baseline_answer(case: Case) -> Answer:
    """Says the best linear operator, and nothing more."""
    return Answer([], [], case.baseline_prediction, 0.0, 0.0)


def deaf_answer(case: Case) -> Answer:
    """Says that something is missing, and has no shape for it."""
    return Answer([UNKNOWN], [], case.baseline_prediction, 0.0, case.gap)


def oracle_answer(case: Case) -> Answer:
    """Knows all but the parameters; where no name is right, the shape."""
    names, shape = case.truth["effects"], None
    if case.suite in ("left_out", "beyond"):
        shape = true_shape(case)
        names = [UNKNOWN]
    return Answer(names, names, case.oracle_prediction, 0.0, case.gap, shape=shape)


def true_shape(case: Case) -> Shape | None:
    """The first of the right shapes, with the true curve in a narrow band where there is one."""
    (name,) = case.truth["effects"]
    rights = right_shapes(name, case.truth)
    if not rights:
        return None
    right = rights[0]
    place = min(right.places)
    channel = min(right.of) if right.id == "free_path" else None
    over = "lag" if channel else min(right.of, default="")
    curve = case.truth["curves"].get(f"{right.id} {place}")
    if curve is not None and right.id == "free_map" and place != "rate":
        curve = replace(curve, value=curve.value - curve.x)
    return Shape(
        right.id,
        place,
        over,
        as_table(curve),
        case.oracle_prediction,
        channel=channel,
        closed=1.0,
    )


def as_table(curve: TrueCurve | None) -> pd.DataFrame:
    """The curve as the search gives one."""
    if curve is None:
        return pd.DataFrame(columns=["value", "low", "high"])
    x = np.linspace(curve.data[0], curve.data[-1], 5001)
    value = np.interp(x, curve.x, curve.value)
    half = HALF_BAND * np.ptp(value)
    return pd.DataFrame({"value": value, "low": value - half, "high": value + half}, index=x)


STAND_INS = {"baseline": baseline_answer, "deaf": deaf_answer, "oracle": oracle_answer}
