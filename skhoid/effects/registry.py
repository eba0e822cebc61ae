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
    """Return the effect with an id, all its parameters to be estimated.

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
            f"No effect is called {name!r}. The effects are: {', '.join(_CLASSES)}."
            f"{did_you_mean(name, _CLASSES)}"
        )
    return _CLASSES[name]()


def title_of(name: str) -> str:
    """Human name of an effect, from its id or its entry in a model, such as ``dead_zone-2``.

    Parameters
    ----------
    name : str
        Id, or id and number.

    Returns
    -------
    title : str

    Examples
    --------
    >>> from skhoid.effects import title_of
    >>> title_of("asym_gain"), title_of("dead_zone-2")
    ('asymmetric gain', 'dead zone (2)')
    """
    base, _, number = name.partition("-")
    known = _CLASSES.get(base)
    title = (known and known.title) or base.replace("_", " ")
    return f"{title} ({number})" if number else title


def titles_of(names: Iterable[str]) -> str:
    """Effects in one phrase: ``bias``, ``bias and dead zone``, ``bias, dead zone and drift``.

    Parameters
    ----------
    names : iterable of str
        Ids, or entries of a model.

    Returns
    -------
    phrase : str

    Examples
    --------
    >>> from skhoid.effects import titles_of
    >>> titles_of(["bias", "dead_zone", "asym_gain"])
    'bias, dead zone and asymmetric gain'
    """
    *others, last = [title_of(name) for name in names] or ["no effect"]
    return f"{', '.join(others)} and {last}" if others else last
