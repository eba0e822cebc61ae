"""True curves of hidden effects, and how near a curve of the answer comes to one.

The gain of a map is the linear operator's, so it does not count, nor does the mean of a gain or of
a delay. A map's curve is what it adds to its argument.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from effects import N_CURVE, Effect, Wiring
from loop import (
    AT_COMMAND,
    AT_INPUT,
    AT_RATE,
    AT_SPRING,
    CLIP,
    CUBIC,
    K_E,
    K_EDOT,
    QUADRATIC,
    TANH,
    TAU,
    U_EXTRA,
    E,
    _curve,
    _seen,
)
from scipy.optimize import minimize_scalar
from signals import KEPT, TIME

QUANTILES = np.linspace(0.025, 0.975, 191)  # the central 95 % of the data
POINTS = 2001
BY_CHANNEL = {"scheduled_gain", "airspeed_gain", "workload_delay"}  # of the speed
STRETCHED = ("command", "output")  # places of maps whose argument is in units of the answer
FORCES = ("spring", "rate")
JUMP = 0.1
OFFSETS = {"bias", "drift", "wandering_offset"}


@dataclass(frozen=True)
class TrueCurve:
    """A curve and where the data lie.

    Parameters
    ----------
    x, value : ndarray
        The curve, x rising.
    data : ndarray
        Abscissas of the training runs, at their 2.5 to 97.5 % quantiles.
    """

    x: np.ndarray
    value: np.ndarray
    data: np.ndarray


def true_curves(
    effect: Effect,
    wirings: list[Wiring],
    outs: list[np.ndarray],
    known: np.ndarray,
    before: np.ndarray,
) -> dict[str, TrueCurve]:
    """Curves of a case with one effect, by ``id place`` of the shape that would show them.

    Parameters
    ----------
    effect : Effect
    wirings : list of Wiring
        Of the training runs.
    outs : list of ndarray
        Their signals.
    known : ndarray of shape (n_runs, n_samples)
        What the operator does in them without remnant.
    before : ndarray of shape (n_runs, n_samples)
        The same without the map behind the error: that is what passes through it.

    Returns
    -------
    curves : dict
        ``id place``: TrueCurve.
    """
    w = wirings[0]
    e, u = np.concatenate([out[E, KEPT] for out in outs]), known.ravel()
    maps = _maps(w, np.abs(e).max(), np.abs(u).max())
    data = {"input": e, "spring": u, "rate": np.gradient(known, TIME, axis=1).ravel()}
    curves = {
        f"free_map {place}": TrueCurve(x, y, np.quantile(data.get(place, before), QUANTILES))
        for place, (x, y) in maps.items()
    }
    over = TIME
    if effect.name in BY_CHANNEL:
        over = np.concatenate([each.given.speed[KEPT] for each in wirings])
        each_run = wirings
    else:
        each_run = wirings[:1]

    def table(column: int) -> np.ndarray:
        return np.concatenate([each.table[KEPT, column] for each in each_run])

    gain, rate_gain = table(K_E) / w.operator.K_e, table(K_EDOT) / w.operator.K_edot
    found = {}
    if np.ptp(gain) > 0 and np.allclose(gain, rate_gain):
        found["free_gain gain"] = gain
    if np.ptp(table(TAU)) > 0:
        found["free_delay delay"] = table(TAU)
    if effect.name in OFFSETS:
        found |= dict.fromkeys(("free_offset sum", "free_offset output"), table(U_EXTRA))
    order = np.argsort(over, kind="stable")
    for key, value in found.items():
        curves[key] = TrueCurve(over[order], value[order], np.quantile(over, QUANTILES))
    return curves


def unmapped(w: Wiring) -> Wiring:
    """The same loop without the static maps behind the error."""
    plain = copy(w)
    plain.outputs = [row for row in w.outputs if row[0] not in (CLIP, TANH)]
    plain.curves = [row for row in w.curves if row[0] not in (AT_COMMAND, AT_SPRING)]
    plain.muscle = w.muscle.copy()
    plain.muscle[[CUBIC, QUADRATIC]] = 0.0
    return plain


def _maps(w: Wiring, e_max: float, u_max: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Static maps by place; of those behind the limb's bandwidth, all that are one."""
    maps = {}
    x = np.linspace(-e_max, e_max, POINTS)
    rows = np.reshape(w.curves, (-1, 3 + N_CURVE))
    if w.maps or any(row[0] == AT_INPUT for row in rows):
        kinds = np.array([[*row, *[0.0] * (4 - len(row))] for row in w.maps]).reshape(-1, 4)
        curves = rows if len(rows) else None
        maps["input"] = x, np.array([_seen(one, kinds, curves) for one in x])
    v = np.linspace(-4 * u_max, 4 * u_max, POINTS)
    force = w.muscle[CUBIC] * v**3 + w.muscle[QUADRATIC] * v * np.abs(v)
    for row in rows:
        tabled = np.array([_curve(one, row) for one in v])
        if row[0] == AT_SPRING:
            force = force + tabled
        elif row[0] == AT_COMMAND:
            maps |= {"command": (v, tabled), "output": (v, tabled), "spring": (tabled, v)}
        elif row[0] == AT_RATE:
            speed = row[1] + row[2] * np.arange(len(row) - 3)
            maps["rate"] = speed, row[3:]
    if np.any(force):
        maps |= {"spring": (v, v + force), "output": (v + force, v), "command": (v + force, v)}
    for operation in w.outputs:
        if operation[0] == CLIP:
            maps |= dict.fromkeys(("command", "output"), (v, np.clip(v, *operation[2:4])))
        elif operation[0] == TANH:
            limited = operation[2] * np.tanh(v / operation[2])
            maps |= dict.fromkeys(("command", "output"), (v, limited))
    return maps


def compare(curve: pd.DataFrame, true: TrueCurve, form: str, place: str) -> dict[str, Any]:
    """How near a curve with its band comes to the truth, in the central 95 % of the data.

    Only what no recording tells is taken from the answer, by least squares. Twice the map of the
    error, or of a spring, behind half the gain is the same: there the truth's whole map is scaled.
    Twice the command before the same output is the same too: there the argument is. A straight
    force of the rate is the limb's damping. Forces are zero at rest.

    Parameters
    ----------
    curve : DataFrame
        Indexed by the abscissa: value, low, high; of a map, what it adds to its argument.
    true : TrueCurve
        Of a map, the whole.
    form, place : str
        Of the shape.

    Returns
    -------
    grade : dict
        inside: whether the band holds the truth everywhere but at its jumps, where no smooth curve
        can; share: of the data where it does; rms: distance over the size of what is not
        proportional (or not constant), jumps and all.
    """
    curve = curve.sort_index()
    at = curve.index.to_numpy(dtype=float)
    scale = _stretched(curve, true) if form == "free_map" and place in STRETCHED else 1.0
    x = true.data * scale
    x = x[(x >= at[0]) & (x <= at[-1])]
    if len(x) < len(true.data) / 2:
        return {"inside": False, "share": 0.0, "rms": np.inf}  # a curve of something else
    said, low, high = (np.interp(x, at, curve[name]) for name in ("value", "low", "high"))
    value = np.interp(x / scale, true.x, true.value)
    if form == "free_map":
        if place in FORCES:
            value = value - np.interp(0.0, true.x, true.value)
        if place == "rate":
            expected = value + x * (x @ (said - value)) / (x @ x)
        else:
            gain = 1.0 if place in STRETCHED else value @ (x + said) / (value @ value)
            expected = gain * value - x
        bent = expected - x * (x @ expected) / (x @ x)
    elif form == "free_gain":
        expected = value * np.mean(said) / np.mean(value)
        bent = expected - np.mean(expected)
    elif form == "free_delay":
        bent = value - np.mean(value)
        expected = bent + np.mean(said)
    else:
        expected = bent = value
    smooth = ~_at_a_jump(value)
    held = ((low <= expected) & (expected <= high))[smooth]
    size = float(np.sqrt(np.mean(bent**2)))
    distance = float(np.sqrt(np.mean((said - expected) ** 2)))
    share = float(held.mean()) * len(x) / len(true.data)
    return {"inside": bool(held.all()), "share": share, "rms": distance / max(size, 1e-12)}


def _stretched(curve: pd.DataFrame, true: TrueCurve) -> float:
    """By how much the argument of the answer's map is larger than the truth's: the nearest maps."""
    at, value = curve.index.to_numpy(dtype=float), np.interp(true.data, true.x, true.value)
    whole = at + curve["value"].to_numpy()

    def apart(log_scale: float) -> float:
        said = np.interp(np.exp(log_scale) * true.data, at, whole)
        return float(np.mean((said - value) ** 2))

    tried = np.linspace(-3, 3, 121)
    best = tried[np.argmin([apart(one) for one in tried])]
    near = minimize_scalar(apart, bounds=(best - 0.05, best + 0.05), method="bounded")
    return float(np.exp(near.x))


def _at_a_jump(value: np.ndarray) -> np.ndarray:
    """Where half a percent of the data sees a tenth of the curve's range, and two points beside."""
    jumps = np.abs(np.diff(value)) > JUMP * np.ptp(value)
    return np.convolve(jumps, np.ones(5), "full")[1 : 1 + len(value)] > 0
