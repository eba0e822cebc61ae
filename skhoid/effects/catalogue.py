"""The catalogue: all effects that a search tries, as a list and as a table."""

from __future__ import annotations

from typing import Any

import pandas as pd

from . import free_forms, in_time, machines, maps, paths, tremor
from .base import Effect
from .entry import catalogued_pairs
from .free_form import FreeForm
from .registry import register, title_of

FILES: tuple[Any, ...] = (in_time, maps, paths, machines, tremor)
CLASSES: tuple[type[Effect], ...] = tuple(getattr(f, name) for f in FILES for name in f.__all__)
BY_NAME = register(CLASSES)
# Tried where no effect with a name fits; no search takes them for names.
FREE_FORMS: tuple[type[FreeForm], ...] = tuple(
    getattr(free_forms, name) for name in free_forms.__all__
)
register(FREE_FORMS)
EXPERIMENTS = catalogued_pairs(BY_NAME)


def catalogue() -> pd.DataFrame:
    """The catalogue as a table.

    Returns
    -------
    table : DataFrame
        One row per effect, indexed by its id: title, class, place, physics, formula, source.

    Examples
    --------
    >>> from skhoid.effects import catalogue
    >>> catalogue().loc["saturation", "place"]
    'output'
    """
    return pd.DataFrame(
        [
            {
                "effect": c.name,
                "title": title_of(c.name),
                "class": c.__name__,
                "place": c().place,
                "physics": c.physics,
                "formula": c.formula,
                "source": c.source,
            }
            for c in CLASSES
        ]
    ).set_index("effect")
