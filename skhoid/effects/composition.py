"""Several effects in one model: named compositions, as ``effect_a + effect_b`` makes them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar

from .._sklearn import BaseComposition
from .registry import effect, title_of

if TYPE_CHECKING:
    from .base import Effect

PLACES = ("input", "delay", "gain", "path", "command", "spring", "inside", "sum", "output")
PASSED = ("input", "gain", "path", "command")  # by what drives an ARX model, in the input's unit


class Composable:
    """What ``+`` can combine: the base class that compositions rely on."""

    name: ClassVar[str]
    place: ClassVar[str]
    keeps_unit: ClassVar[bool]

    def __add__(self, other: Any) -> Effects:
        return Effects.of(self) + other

    def check_choices(self) -> None:
        """Raise an error where an argument is none of its options."""


class Effects(BaseComposition):
    """A flat, named composition of effects, as ``effect_a + effect_b`` makes it.

    Parameters
    ----------
    steps : list of (str, Effect)
        Names and effects. Signals pass through effects of the same place in this order.

    See Also
    --------
    Effect : One effect.

    Examples
    --------
    >>> from skhoid.effects import Bias, DeadZone
    >>> both = DeadZone(width=0.3) + Bias()
    >>> [name for name, _ in both.steps]
    ['dead_zone', 'bias']
    >>> both.get_params()["dead_zone__width"]
    0.3
    >>> [name for name, _ in (both + DeadZone()).steps]
    ['dead_zone', 'bias', 'dead_zone-2']
    """

    def __init__(self, steps: list[tuple[str, Effect]]):
        self.steps = steps

    @classmethod
    def of(cls, effects: Any) -> Effects:
        """Make a composition from None, ids of the catalogue, effects, compositions, lists of them.

        >>> from skhoid.effects import Effects
        >>> Effects.of(["dead_zone", "bias"]).names
        ['dead_zone', 'bias']
        """
        if isinstance(effects, Effects):
            steps = effects.steps
        else:
            steps = []
            if effects is None:
                return cls([])
            listed = effects if isinstance(effects, (list, tuple)) else [effects]
            many = (Effects, list, tuple)
            for item in listed:
                steps = steps + (cls.of(item).steps if isinstance(item, many) else [_named(item)])
        named: list[tuple[str, Effect]] = []
        for name, one in steps:
            if not isinstance(one, Composable):
                raise TypeError(
                    f"An effect must be an instance of skhoid.effects.Effect; got {one!r}."
                )
            one.check_choices()
            if one.place not in PLACES:
                raise ValueError(
                    f"{type(one).__name__}.place must be one of {', '.join(PLACES)}; got "
                    f"{one.place!r}."
                )
            taken = {n for n, _ in named}
            base, number, unique = name, 1, name
            while unique in taken:
                number += 1
                unique = f"{base}-{number}"
            named.append((unique, one))
        return cls(named)

    @property
    def names(self) -> list[str]:
        """Names, in the order of the steps."""
        return [name for name, _ in self.steps]

    def __iter__(self) -> Iterator[tuple[str, Effect]]:
        return iter(self.steps)

    def __len__(self) -> int:
        return len(self.steps)

    def before(self, name: str, on_arx: bool) -> tuple[str, ...]:
        """Titles of those that a signal has passed before an effect, and that change its unit.

        The command of an operator has the unit of the output, whatever became of the error.
        """
        at = self.names.index(name)
        place = self.steps[at][1].place
        passed: tuple[str, ...] = (place,) if place in ("input", "command", "output") else ()
        if on_arx and place in ("command", "spring", "inside"):
            passed = PASSED
        return tuple(
            title_of(n)
            for i, (n, e) in enumerate(self.steps)
            if e.place in passed and not e.keeps_unit and (i < at or e.place != place)
        )

    def __add__(self, other: Any) -> Effects:
        return Effects.of([*(e for _, e in self.steps), *(e for _, e in Effects.of(other).steps)])

    def get_params(self, deep: bool = True) -> dict:
        """Names and values of the parameters; of all effects, ``<name>__<parameter>``, if deep."""
        return self._get_params("steps", deep=deep)

    def set_params(self, **params: Any) -> Effects:
        """Set parameters, of effects by ``<name>__<parameter>``."""
        self._set_params("steps", **params)
        return self


def _named(item: Any) -> tuple[str, Effect]:
    if isinstance(item, str):
        item = effect(item)
    if isinstance(item, type):
        raise TypeError(f"Pass an instance, {item.__name__}(), not the class {item.__name__}.")
    return getattr(item, "name", type(item).__name__), item
