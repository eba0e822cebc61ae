"""A smooth map of the error, the command or the output, of any shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .base import Effect
from .core_kind import CoreKind
from .dimension import Dimension, E, S, U
from .error_scan import ErrorScan
from .free_form import N_KNOTS, FreeForm
from .operator_signals import N_PLACES
from .record import Record, differentiated
from .sensor import cores_by_signs
from .smooth_curve import LEVEL, SLOPE
from .static_map import PLACE_OF

OVER = {"error": "e", "command": "command", "output": "u", "spring": "u", "rate": "du/dt"}
NEAR_REST = (-0.2, -0.05, 0.0, 0.05, 0.2)  # knots of a force of the rate, in rms of the rate
ONE_SIDED = 0.05  # of the range, by which a size may fall below zero
OPPOSING = ("spring", "rate")  # places of forces against the command
WORDS = {
    "error": "it acts on the error, as a function of its size and sign",
    "command": "it acts on the command before the limb, as a function of its size and sign",
    "output": "it acts on the output, as a function of its size and sign",
    "spring": "it is a force against the command, as a function of the output",
    "rate": "it is a force against the command, as a function of the output's rate",
}


class FreeMap(FreeForm):
    """A map of a signal, sample by sample, that may have any smooth shape.

    signal' = signal + curve(signal), where the curve has no linear part, which is the gain. At the
    places ``"spring"`` and ``"rate"`` the curve is a force of the output u, or of its rate, against
    the command: spring and friction of any shape. Their linear parts are stiffness and damping. An
    ARX model has it in its recursion, A(q) u = B(q) (x - curve(u)).

    Parameters
    ----------
    at : {"error", "command", "output", "spring", "rate"} or None, default=None
        What is mapped, or a force of what; None means the error, and a search for shapes tries all.
    knots : tuple of float or None, default=None
        Where the curve is given; None means quantiles of the signal.
    values : tuple of float or None, default=None
        The curve at the knots, in units of the signal, or of the command for a force; None
        estimates it.
    spread : float or None, default=None
        Size of the curve's smoothest part, in the same units, that decides how smooth it is;
        None chooses it by likelihood.
    folded : bool or None, default=None
        Whether the curve has a linear part too, over outputs of either sign, as an output needs
        whose sign a sensor may not show; None tries it where a model without the map shows less
        than half of the output. It is zero at the greatest output, which gives the signal its size.

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

    def __init__(
        self,
        *,
        at: str | None = None,
        knots: tuple[float, ...] | None = None,
        values: tuple[float, ...] | None = None,
        spread: float | None = None,
        folded: bool | None = None,
    ):
        self.at = at
        self.knots = knots
        self.values = values
        self.spread = spread
        self.folded = folded

    @property
    def where(self) -> str:
        """What is mapped."""
        return self.at or "error"

    @property
    def kept(self) -> tuple[int, ...]:  # type: ignore[override]
        if self.folded:
            return (SLOPE,)
        return () if self.where in OPPOSING else (LEVEL,)

    @property
    def place(self) -> str:  # type: ignore[override]
        return "spring" if self.where in OPPOSING else PLACE_OF[self.where]

    @property
    def over(self) -> str:
        return OVER[self.where]

    @property
    def abscissa(self) -> Dimension:
        return {"error": E, "rate": U / S}.get(self.where, U)

    @property
    def ordinate(self) -> Dimension:
        return E if self.where == "error" else U

    @property
    def y_word(self) -> str:  # type: ignore[override]
        if self.folded:
            return "change of the output"
        return "force" if self.where in OPPOSING else "departure from a straight line"

    @property
    def sentence(self) -> str:
        return WORDS[self.where]

    def alternatives(self, record: Record) -> list[Any]:
        """One for each place; a linear model without a limb has no command of its own."""
        places = [at for at in OVER if at != "command" or record.core != CoreKind.ARX]
        return [self.with_choices(at=at) for at in places] if self.at is None else [self]

    def watched(self, record: Record) -> np.ndarray:
        if self.where == "error":
            return record.input[record.known]
        if self.where in OPPOSING:  # of the output itself, which a hopeless model does not show
            return moved(record) if self.where == "rate" else seen(record)[record.known]
        output = record.prediction if record.prediction is not None else record.y
        assert output is not None
        return output[record.known]

    def variants(self, record: Record) -> list[Effect]:
        whole = self.knots is None and self.folded is None and self.where == "output"
        folded = self.with_choices(folded=True) if whole and hidden(record) else self
        return [folded.with_knots(record)]

    def scanned(self, error_of: ErrorScan, record: Record) -> list[dict[str, float]]:
        """Where the output may be folded, what moves it by signs that make its size smooth."""
        if not self.folded or not self.free:
            return []
        (fold,) = self.starts(record)
        return [{**fold, **core} for core in cores_by_signs(error_of, record)]

    def starts(self, record: Record) -> list[dict[str, float]]:
        """A straight line; where the output may be folded, its size without its sign."""
        if not self.folded or not self.free:
            return super().starts(record)
        at = np.asarray(self.knots)
        return [self.coefficients(np.abs(at) - at)]

    def with_knots(self, record: Record) -> Any:
        if self.knots is None and self.folded:
            size = float(np.abs(seen(record)[record.known]).max())
            return self.with_choices(knots=tuple(np.linspace(-size, size, N_KNOTS).tolist()))
        if self.knots is not None or self.where not in OPPOSING:
            return super().with_knots(record)
        watched = self.watched(record)
        knots = wide_knots(watched)
        return self.with_choices(knots=with_rest(knots, watched) if self.where == "rate" else knots)

    @property
    def _zero(self) -> float | None:
        """Where the curve is zero: a force at rest, as its level is the model's own.

        A fold where it is greatest: the model's gain and the map's could undo each other.
        """
        if self.knots is None or not (self.folded or self.where in OPPOSING):
            return None
        return self.knots[-1] if self.folded else min(max(0.0, self.knots[0]), self.knots[-1])

    def with_values(self, values: Mapping[str, float]) -> Any:
        found, zero = super().with_values(values), self._zero
        if zero is None:
            return found
        level = float(self.curve(np.asarray(found.values), np.array([zero]))[0])
        return found.with_choices(values=tuple(value - level for value in found.values))

    def design(self, at: np.ndarray) -> np.ndarray:
        found, zero = super().design(at), self._zero
        return found if zero is None else found - super().design(np.array([zero]))

    def shaped(self, signal: Any, record: Record, curve: Callable[..., np.ndarray]) -> Any:
        level = 0.0 if self._zero is None else curve(np.array([self._zero]))
        if self.where in OPPOSING:
            assert self.knots is not None
            low, high = self.knots[0], self.knots[-1]
            force = curve(np.linspace(low, high, N_PLACES)) - level
            return signal.bent(force, low, high, of_rate=self.where == "rate")
        if self.where != "command":
            return signal + curve(signal) - level
        whole = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(position=whole + curve(whole), rate=np.zeros_like(signal.rate))


def hidden(record: Record) -> bool:
    """Whether a model shows less than half of the output, about its mean."""
    if record.y is None or record.prediction is None:
        return False
    y = record.y[record.known]
    left = y - record.prediction[record.known]
    return float(left @ left) > 0.5 * float(np.var(y)) * y.size


def one_sided(record: Record) -> bool:
    """Whether the output keeps its sign and comes near zero, as a size does."""
    y = seen(record)[record.known]
    return bool(min(abs(y.min()), abs(y.max())) < ONE_SIDED * np.ptp(y))


def seen(record: Record) -> np.ndarray:
    """The measured output, or the simulated one where nothing was measured."""
    output = record.y if record.y is not None else record.prediction
    assert output is not None
    return output


def wide_knots(signal: np.ndarray) -> tuple[float, ...]:
    """Knots half-way between quantiles and equal distances, from the least to the greatest value.

    Forces of springs are greatest where the output seldom is.
    """
    levels = np.linspace(0.0, 1.0, N_KNOTS)
    equal = signal.min() + levels * np.ptp(signal)
    return tuple(((np.quantile(signal, levels) + equal) / 2).tolist())


def with_rest(knots: tuple[float, ...], rate: np.ndarray) -> tuple[float, ...]:
    """Knots with further ones about zero, as friction is steep where motion turns."""
    near = float(np.sqrt(np.mean(rate**2))) * np.array(NEAR_REST)
    if not knots[0] < near[0] < near[-1] < knots[-1]:
        return knots
    ends = knots[0], knots[-1]
    apart = (k for k in knots[1:-1] if np.abs(near - k).min() > near[-1] - near[-2])
    return tuple(sorted([*ends, *apart, *near.tolist()]))


def moved(record: Record) -> np.ndarray:
    """Rates of the output where two samples are known."""
    both = record.known[1:] & record.known[:-1]
    return (np.diff(seen(record), axis=0) / record.dt)[both]
