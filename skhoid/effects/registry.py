"""Effects by their ids; the catalogue fills it, and what takes an id looks it up here."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..exceptions import did_you_mean

if TYPE_CHECKING:
    from .base import Effect

_CLASSES: dict[str, type[Effect]] = {}


def register(classes: Iterable[type[Effect]]) -> dict[str, type[Effect]]:
    """Make classes known by their ids, and return them so."""
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
