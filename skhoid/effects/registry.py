"""The registry of effects by id: the catalogue fills it, and ids are looked up here."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..exceptions import did_you_mean

if TYPE_CHECKING:
    from .base import Effect

_CLASSES: dict[str, type[Effect]] = {}


def register(classes: Iterable[type[Effect]]) -> dict[str, type[Effect]]:
    """Register classes under their ids, and return them by id."""
    named = {c.name: c for c in classes}
    _CLASSES.update(named)
    return named


def effect(name: str) -> Effect:
    """The effect of an id, with everything to be estimated.

    Parameters
    ----------
    name : str
        Id, such as ``"dead_zone"``.

    Returns
    -------
    effect : Effect

    Examples
    --------
    >>> from skhoid.effects import effect
    >>> effect("dead_zone")
    DeadZone()
    """
    if name not in _CLASSES:
        raise ValueError(
            f"No effect is called {name!r}. There are: {', '.join(_CLASSES)}."
            f"{did_you_mean(name, _CLASSES)}"
        )
    return _CLASSES[name]()
