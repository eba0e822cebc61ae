"""A smooth map of the error, the command or the output, of any shape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .core_kind import CoreKind
from .dimension import Dimension, E, U
from .free_form import FreeForm
from .record import Record, differentiated
from .smooth_curve import LEVEL
from .static_map import PLACE_OF

OVER = {"error": "e", "command": "command", "output": "u"}
WORDS = {
    "error": "it acts on the error, as a function of its size and sign",
    "command": "it acts on the command before the limb, as a function of its size and sign",
    "output": "it acts on the output, as a function of its size and sign",
}


class FreeMap(FreeForm):
    """A map of a signal, sample by sample, that may have any smooth shape.

    signal' = signal + curve(signal), where the curve has no linear part, which is the gain.

    Parameters
    ----------
    at : {"error", "command", "output"} or None, default=None
        What is mapped; None means the error, and a search for shapes tries all.
    knots : tuple of float or None, default=None
        Where the curve is given; None means quantiles of the signal.
    values : tuple of float or None, default=None
        The curve at the knots, in units of the signal; None estimates it.
    spread : float or None, default=None
        Size of the curve's smoothest part, in units of the signal, that decides how smooth it is;
        None chooses it by likelihood.

    References
    ----------
    Eilers and Marx, Flexible smoothing with B-splines and penalties (1996). Wood, Generalized
    additive models (2017).

    Examples
    --------
    >>> from skhoid.effects import FreeMap
    >>> FreeMap(at="output").place
    'output'
    """

    name = "free_map"
    title = "free map"
    physics = "A signal is mapped by a curve of unknown shape."
    formula = "signal + curve(signal)"
    tex = r"s' = s + \mathrm{curve}(s)"
    source = "Eilers and Marx (1996)"
    kept = (LEVEL,)

    def __init__(
        self,
        *,
        at: str | None = None,
        knots: tuple[float, ...] | None = None,
        values: tuple[float, ...] | None = None,
        spread: float | None = None,
    ):
        self.at = at
        self.knots = knots
        self.values = values
        self.spread = spread

    @property
    def where(self) -> str:
        """What is mapped."""
        return self.at or "error"

    @property
    def place(self) -> str:  # type: ignore[override]
        return PLACE_OF[self.where]

    @property
    def over(self) -> str:
        return OVER[self.where]

    @property
    def abscissa(self) -> Dimension:
        return E if self.where == "error" else U

    @property
    def ordinate(self) -> Dimension:
        return self.abscissa

    @property
    def sentence(self) -> str:
        return WORDS[self.where]

    def alternatives(self, record: Record) -> list[Any]:
        """One for each place; a linear model without a limb has no command of its own."""
        places = ("error", "output") if record.core == CoreKind.ARX else tuple(OVER)
        return [self.with_choices(at=at) for at in places] if self.at is None else [self]

    def watched(self, record: Record) -> np.ndarray:
        if self.where == "error":
            return record.input[record.known]
        output = record.prediction if record.prediction is not None else record.y
        assert output is not None
        return output[record.known]

    def shaped(self, signal: Any, record: Record, curve: Callable[..., np.ndarray]) -> Any:
        if self.where != "command":
            return signal + curve(signal)
        whole = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(position=whole + curve(whole), rate=np.zeros_like(signal.rate))
