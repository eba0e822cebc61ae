"""The kinds of linear core that effects act in; add one here."""

from __future__ import annotations

from enum import StrEnum


class CoreKind(StrEnum):
    """Kind of linear core that an effect acts in: the argument ``core`` of ``Effect.refusal``.

    Attributes
    ----------
    OPERATOR
        A human operator with a given delay.
    OPERATOR_FREE_DELAY
        A human operator whose delay is estimated with the other parameters.
    ARX
        An ARX model.

    Examples
    --------
    >>> from skhoid.effects import CoreKind
    >>> [kind.is_operator for kind in CoreKind]
    [True, True, False]
    >>> CoreKind("arx")
    <CoreKind.ARX: 'arx'>
    """

    OPERATOR = "operator"
    OPERATOR_FREE_DELAY = "operator, free delay"
    ARX = "arx"

    @property
    def is_operator(self) -> bool:
        """Whether it is a human operator, with its delay given or estimated."""
        return self is not CoreKind.ARX
