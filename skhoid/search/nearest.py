"""Effects of the catalogue whose curves lie nearest to that of a shape, and what separates them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..effects.base import Effect
from ..effects.catalogue import CLASSES
from ..effects.free_form import FreeForm
from ..effects.record import Record
from ..effects.registry import title_of
from .explanations import ANY_EXPERIMENT, EXPERIMENTS
from .likeness import Likeness, departure_of

COLUMNS = ("title", "form", "distance", "within_band", "parameters")
PLACES = {
    "spring": ("spring", "inside"),
    "gain": ("gain", "command"),
    "path": ("path", "command"),
}
LEAST_SHARE = 0.1  # of the band's half-width, below which no recording of use shows a difference
N_TIMES = 401
APART = 0.25  # of the greatest difference, from which two curves differ


@dataclass(frozen=True)
class Near:
    """An effect of the catalogue with the numbers at which its curve is nearest to a shape's.

    Attributes
    ----------
    name : str
        Its id.
    form : str
        Its form, if it has several.
    distance : float
        Rms of the difference of both curves, relative to the shape's.
    within_band : bool
        Whether it lies inside the simultaneous band everywhere.
    parameters : str
        Values with units.
    curve : ndarray
        Over the abscissa of the shape's curve.
    """

    name: str
    form: str
    distance: float
    within_band: bool
    parameters: str
    curve: np.ndarray


def nearest_effects(
    form: FreeForm,
    curve: pd.DataFrame,
    record: Record,
    units: Mapping[str, str | None],
    gains: tuple[float, float] = (1.0, 0.0),
) -> list[Near]:
    """Effects that act where a free form does, nearest first, each fitted to its curve.

    Parameters
    ----------
    form : FreeForm
        With its values.
    curve : DataFrame
        Its value, and low and high of its band, over the abscissa.
    record : Record
        In which it was found, with the model's prediction.
    units : dict of str to str
        Of the data, for the parameters.
    gains : (float, float)
        Of the model, on error and error rate.

    Returns
    -------
    found : list of Near
        The best variant of each effect that has a curve there.
    """
    grid = curve.index.to_numpy(dtype=float)
    like = Likeness.of(form, grid, curve["value"].to_numpy(), record, gains)
    half = ((curve["high"] - curve["low"]) / 2).to_numpy()
    found: dict[str, Near] = {}
    for effect in candidates(form, record):
        near = _fitted(effect, like, record, half, units, gains)
        if near is not None and not near.distance >= found.get(effect.name, _FAR).distance:
            found[effect.name] = near
    return sorted(found.values(), key=lambda near: near.distance)


_FAR = Near("", "", np.inf, False, "", np.empty(0))


def candidates(form: FreeForm, record: Record) -> Iterator[Effect]:
    """Variants of the effects of the catalogue that act where a free form does."""
    places = PLACES.get(form.place, (form.place,))
    for kind in CLASSES:
        effect = kind()
        if effect.noise or effect.refusal_in(record, record.core):
            continue
        for one in effect.alternatives(record):
            variants: list[Any] = one.variants(record)
            yield from (
                _timed(form, v)
                for v in variants
                if v.place in places and _alike(form, v) and _follows(form, v)
            )


def _alike(form: FreeForm, effect: Effect) -> bool:
    """Whether an effect of the place can have a curve over the same."""
    if form.place == "gain":
        return effect.place == "gain" or effect.name == "lapses"
    if form.place == "path" and effect.place == "command":
        return form.name == "free_dynamics" and hasattr(effect, "form") is False
    return True


def _follows(form: FreeForm, effect: Any) -> bool:
    """Whether a variant is over the same channel, or over time, and has memory or not."""
    channel = getattr(form, "channel", None)
    own = getattr(effect, "channel", None)
    if form.name in ("free_map", "free_hysteresis") and form.place != "spring":
        return remembers(effect) == (form.name == "free_hysteresis")
    if form.place == "path":
        return True
    return own == channel


def _timed(form: Any, effect: Any) -> Effect:
    """A variant; lapses are where the gains of a shape are less than half of the usual."""
    if effect.name != "lapses":
        return effect
    t = np.linspace(form.knots[0], form.knots[-1], N_TIMES)
    gains = form.at_rest + form.curve(np.asarray(form.values), t)
    away = np.r_[False, gains < np.median(gains) / 2, False].astype(int)
    ends = zip(np.flatnonzero(np.diff(away) == 1), np.flatnonzero(np.diff(away) == -1), strict=True)
    stretches = [(float(t[a]), float(t[np.minimum(b, N_TIMES - 1)])) for a, b in ends]
    return effect.with_choices(intervals=stretches)


def remembers(effect: Effect) -> bool:
    """Whether what an effect makes of a sample depends on the samples before it."""
    return not hasattr(effect, "mapped") and effect.name not in ("rectified", "sensor_magnitude")


def _fitted(
    effect: Effect,
    like: Likeness,
    record: Record,
    half: np.ndarray,
    units: Mapping[str, str | None],
    gains: tuple[float, float],
) -> Near | None:
    names = [p.name for p in effect.free]
    limits = effect.limits(record)
    low, high = (np.array([limits[name][end] for name in names]) for end in (0, 1))
    begun = effect.starts(record)
    starts = np.array([[start[name] for name in names] for start in begun], dtype=float)
    starts = starts.reshape(len(begun), len(names))
    fixed = effect.fixed

    def departure(values: np.ndarray) -> np.ndarray:
        own = fixed | dict(zip(names, values.tolist(), strict=True))
        with np.errstate(all="ignore"):
            return departure_of(like.form, effect, own, record, gains)(like.at)

    fit = like.fitted(departure, starts, low, high)
    if fit is None:
        return None
    texts = []
    for parameter, value, acts in zip(effect.free, fit.values, fit.acts, strict=True):
        if acts:
            unit = parameter.dimension_on(record, effect.place).label(units)
            texts.append(f"{parameter.name} = {value:.4g}{'' if unit == '-' else f' {unit}'}")
    within = bool((np.abs(fit.curve - like.value) <= half).all())
    form = str(getattr(effect, "form", None) or "")
    shown = fit.curve + like.form.at_rest
    return Near(effect.name, form, fit.distance, within, ", ".join(texts), shown)


def nearest_table(found: Sequence[Near]) -> pd.DataFrame:
    """The nearest effects as a table, by id."""
    rows: list[Any] = [
        (title_of(n.name), n.form, n.distance, n.within_band, n.parameters) for n in found
    ]
    index = pd.Index([near.name for near in found], name="effect", dtype=object)
    return pd.DataFrame(rows, columns=list(COLUMNS), index=index)


def recordings_for(
    form: FreeForm, curve: pd.DataFrame, found: Sequence[Near], unit: str
) -> list[str]:
    """What to record to tell the shape from the nearest effect, and both nearest apart."""
    if not found:
        return []
    grid, value = curve.index.to_numpy(dtype=float), curve["value"].to_numpy()
    half = ((curve["high"] - curve["low"]) / 2).to_numpy()
    first = found[0]
    lines = []
    if form.over != "lag":
        apart = np.abs(value - first.curve)
        title = title_of(first.name)
        if first.within_band and (apart > LEAST_SHARE * half).any():
            lines.append(
                f"To tell the shape from {title}, {_where(form, grid, apart, half, unit)}."
            )
    if len(found) > 1 and found[1].within_band:
        one, other = title_of(first.name), title_of(found[1].name)
        known = EXPERIMENTS.get(frozenset({first.name, found[1].name}))
        if known is None and form.over != "lag":
            known = _where(form, grid, np.abs(first.curve - found[1].curve), half, unit)
        lines.append(f"To tell {one} from {other}, {known or ANY_EXPERIMENT}.")
    return lines


def _where(form: FreeForm, grid: np.ndarray, apart: np.ndarray, half: np.ndarray, unit: str) -> str:
    """Where curves differ most, relative to the band, and what to record there."""
    there = apart > APART * apart.max()
    at = float(grid[np.argmax(np.where(there, apart / np.maximum(half, 1e-300), 0.0))])
    label = "" if unit == "-" or "[" in unit else f" {unit}"
    share = float(np.max(apart / np.maximum(half, 1e-300)))
    more = max(int(np.ceil(1 / max(share, LEAST_SHARE) ** 2)), 2)
    what = {
        "e": "errors",
        "u": "outputs",
        "du/dt": "rates of the output",
        "command": "commands",
        "time": "runs",
    }.get(form.over, f"values of {form.over}")
    times = f"some {more} times as much data" if share > LEAST_SHARE else "many times as much data"
    if form.over == "time":
        return f"record {times} of the same task: they differ most at {at:.3g}{label}"
    return f"record {times} with {what} near {at:.3g}{label}, where the two differ most"
