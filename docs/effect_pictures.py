"""Pictures of effects for their cards: what `EffectDisplay` computes, as small SVGs.

The curves come from the effect objects themselves, beside a model fitted to simulated runs.
"""

import re
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from skhoid import OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import Effect
from skhoid.model.effect_curves import EffectCurves, effect_curves

WIDTH, HEIGHT = 240, 150
LEFT, RIGHT, TOP, BOTTOM = 10, 230, 26, 128
KINDS = ("with", "also")  # classes of the lines with the effect, of effects.css
STRAIGHT = 0.1  # of a unit of the picture, off a line through its neighbours


@cache
def models() -> tuple[dict[str, Any], pd.DataFrame]:
    """A person's model, a machine's, and the runs; channels besides e are there to be answered."""
    X, y = make_tracking_runs(
        "C1", n_runs=2, sampling_rate=50, channels=("e", "x", "f_t"), random_state=0
    )
    t = np.asarray(X.index.get_level_values("time"))
    X["speed"] = 3.0 + np.sin(0.1 * t)
    for name in ("dist", "motion", "other"):
        X[name] = np.sin(0.7 * t)
    X.attrs["units"], y.attrs["units"] = {}, {}
    person = OperatorRegressor(controlled_element="1/(s(s+1))").fit(X, y)
    machine = SimulatedARX(2, 2, nk=14, inputs=["e"], effects="bias").fit(X, y)
    return {"human": person, "machine": machine}, X


def curves_of(effect: Effect) -> EffectCurves:
    """What an effect with numbers does."""
    found, X = models()
    model = found[effect.domains[0]]
    scheduled = effect.place == "gain" and hasattr(effect, "channel")
    of_runs = X if scheduled else None  # for the values of the channel
    return effect_curves(model, effect.name, of_runs, effect=effect)


def picture(effect: Effect, labels: bool = True) -> str:
    """An effect as an SVG to be part of a page, whose theme colours it."""
    curves, over, beside = drawn(effect)
    if not labels:
        view = f"{LEFT - 2} {TOP - 2} {RIGHT - LEFT + 4} {BOTTOM - TOP + 4}"
        return f'<svg class="effect-picture" viewBox="{view}" aria-hidden="true">{curves}</svg>'
    return (
        f'<svg class="effect-picture" viewBox="0 0 {WIDTH} {HEIGHT}" role="img"'
        f' aria-label="{over} over {beside}, with the effect and without">{curves}'
        f'<text x="{LEFT}" y="17">{over}</text>'
        f'<text x="{RIGHT}" y="{HEIGHT - 5}" text-anchor="end">{beside}</text></svg>'
    )


def make_key(effect: Effect) -> list[tuple[str, str]]:
    """Class and words of each line of its picture."""
    names = [name.split(":")[0] for name in curves_of(effect).curves]
    words = ["with the effect"] if len(names) == 1 else [f"with the effect: {n}" for n in names]
    return [*zip(KINDS, words, strict=False), ("without", "without")]


@cache
def drawn(effect: Effect) -> tuple[str, str, str]:
    """Its curves as parts of an SVG, and the labels of the axes."""
    found = curves_of(effect)
    logarithmic = found.kind == "gain"
    lines = [(c.x, c.y, kind) for c, kind in zip(found.curves.values(), KINDS, strict=False)]
    lines.append((found.without.x, found.without.y, "without"))
    if logarithmic:
        lines = [(np.log10(x), np.log10(y), kind) for x, y, kind in lines]
    x = np.concatenate([line[0] for line in lines])
    y = np.concatenate([line[1] for line in lines])
    low, high = float(y.min()), float(y.max())
    if logarithmic:
        low, high = min(low, -0.18), max(high, 0.18)
    elif found.kind in ("gains", "delay"):
        low = min(low, 0.0)
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)

    def across(values: Any) -> Any:
        return LEFT + (values - x.min()) / (x.max() - x.min()) * (RIGHT - LEFT)

    def up(values: Any) -> Any:
        return BOTTOM - (values - low) / (high - low) * (BOTTOM - TOP)

    parts = [
        f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{RIGHT - LEFT}" height="{BOTTOM - TOP}"/>'
    ]
    if not logarithmic and low < 0.0 < high:
        parts.append(f'<path class="axis" d="M{LEFT} {up(0.0):.1f}H{RIGHT}"/>')
    if not logarithmic and x.min() < 0.0 < x.max():
        parts.append(f'<path class="axis" d="M{across(0.0):.1f} {TOP}V{BOTTOM}"/>')
    for line_x, line_y, kind in reversed(lines):
        loop = found.kind == "loop" and kind != "without"
        parts.append(f'<path class="{kind}" d="{_path(across(line_x), up(line_y), loop)}"/>')
    return "".join(parts), _plain(found.ylabel), _plain(found.xlabel)


def _path(x: np.ndarray, y: np.ndarray, closed: bool) -> str:
    """The d of a path, without the points that lie on a line through their neighbours."""
    points = np.column_stack([x, y])
    kept = [0]
    for k in range(2, len(points)):
        start, end = points[kept[-1]], points[k]
        between = points[kept[-1] + 1 : k] - start
        along = end - start
        off = np.abs(between[:, 0] * along[1] - between[:, 1] * along[0])
        if off.max() > STRAIGHT * max(float(np.hypot(*along)), 1e-9):
            kept.append(k - 1)
    kept.append(len(points) - 1)
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in points[kept]) + ("Z" if closed else "")


def _plain(label: str) -> str:
    """A label of an axis without its unit, and without mathematics."""
    return re.sub(r",.*| \([^)]*\)$|\$", "", label)
