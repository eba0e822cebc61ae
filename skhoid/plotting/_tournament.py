"""What pictures of tournaments share: a colour and a mark for each method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.lines import Line2D

from ._roles import background, scaled, series_colour, sized

EVERY = "os^Dv<>PXhp*d8H"


def method_style(methods: Sequence[str], method: str, causal: bool) -> dict[str, Any]:
    """Keywords of a method's mark: filled if it is causal."""
    place = list(methods).index(method)
    colour = series_colour(place)
    return {
        "marker": EVERY[place % len(EVERY)],
        "ms": sized(6),
        "color": colour,
        "markerfacecolor": colour if causal else background(),
        "markeredgecolor": colour,
        "markeredgewidth": scaled(1.2),
        "ls": "none",
    }


def method_handles(methods: Sequence[str], causal: Sequence[bool]) -> list[Any]:
    """Handles of a legend."""
    return [
        Line2D([], [], **method_style(methods, method, bool(kind)))
        for method, kind in zip(methods, causal, strict=True)
    ]
