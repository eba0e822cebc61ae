"""Hysteresis of any shape: plays of several widths side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _kernels
from .core_kind import CoreKind
from .dimension import ONE, Dimension, U
from .free_form import FreeForm
from .parameter import Parameter
from .record import Record, differentiated
from .static_map import PLACE_OF

N_PLAYS = 10
WIDEST = 0.95  # quantile of the signal's size, the half-width of the widest play
OVER = {"command": "command", "output": "u"}


@dataclass(frozen=True)
class LoadingCurve:
    """What hysteresis takes from a signal that rises from rest for the first time, or falls.

    A polygon with corners at the half-widths of plays; beyond the widest it is constant. The
    basis has one curve for each play, in proportion to its weight.

    Parameters
    ----------
    knots : tuple of float
        Half-widths of the plays, rising and positive.
    """

    knots: tuple[float, ...]

    @property
    def basis(self) -> np.ndarray:
        """Values at the knots of each curve of the basis, of shape (n_knots, n_plays)."""
        knots = np.asarray(self.knots)
        return -np.minimum(knots[:, None], knots[None, :])

    @property
    def roughness(self) -> np.ndarray:
        """Of each play: all are as likely."""
        return np.ones(len(self.knots))

    def weights(self, values: np.ndarray) -> np.ndarray:
        """Weights of the plays for values at the knots."""
        return np.linalg.solve(self.basis, values)

    def __call__(self, values: np.ndarray, at: np.ndarray) -> np.ndarray:
        """A curve, or several as columns, with ``values`` at the knots, at any points."""
        at = np.asarray(at, dtype=float)
        tail = (...,) + (None,) * (np.ndim(values) - 1)
        by_play = np.minimum(np.abs(at)[..., None], np.asarray(self.knots))
        return np.sign(at)[tail] * (-by_play @ self.weights(np.asarray(values)))


class FreeHysteresis(FreeForm):
    """Hysteresis of any shape that does not depend on speed: play, friction with a spring, or both.

    Prandtl and Ishlinskii's model: signal' = signal - sum of weight_i (signal - play_i), where the
    plays trail the signal by at most their half-widths. One play with weight one is
    :class:`Backlash`. Its curve is what is taken from a signal that leaves rest for the first time,
    over the signal.

    Parameters
    ----------
    at : {"output", "command"} or None, default=None
        What is mapped; None means the output, and a search for shapes tries both.
    knots : tuple of float or None, default=None
        Half-widths of the plays, in units of the output; None means equal distances up to nearly
        the greatest distance of the signal from its mean.
    values : tuple of float or None, default=None
        The curve at the knots, in units of the output; None estimates it.
    spread : float or None, default=None
        Usual size of the weights; None chooses it by likelihood.

    References
    ----------
    Brokate and Sprekels, Hysteresis and phase transitions (1996), sections 2.3 and 2.4.

    Examples
    --------
    >>> from skhoid.effects import FreeHysteresis
    >>> FreeHysteresis(at="command").place
    'command'
    """

    name = "free_hysteresis"
    title = "free hysteresis"
    physics = "A signal depends on where it turned, by a curve of unknown shape."
    formula = "signal - sum of weight_i (signal - play_i(signal))"
    tex = r"s' = s - \sum_i w_i\,(s - \mathrm{play}_i(s))"
    source = "Brokate and Sprekels (1996)"
    y_word = "what play takes"

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
        return self.at or "output"

    @property
    def place(self) -> str:  # type: ignore[override]
        return PLACE_OF[self.where]

    @property
    def over(self) -> str:
        return OVER[self.where]

    @property
    def abscissa(self) -> Dimension:
        return U

    @property
    def ordinate(self) -> Dimension:
        return U

    @property
    def sentence(self) -> str:
        return "it has memory: the output depends on where the signal turned"

    @property
    def curve(self) -> Any:
        assert self.knots is not None
        return LoadingCurve(tuple(self.knots))

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        if self.values is not None or self.knots is None:
            return ()
        return tuple(
            Parameter(f"c{i}", ONE, -10.0, 10.0, (0.0,), f"weight of play {i}")
            for i in range(len(self.knots))
        )

    def alternatives(self, record: Record) -> list[Any]:
        """One for each place; a linear model without a limb has no command of its own."""
        places = ("output",) if record.core == CoreKind.ARX else ("output", "command")
        return [self.with_choices(at=at) for at in places] if self.at is None else [self]

    def watched(self, record: Record) -> np.ndarray:
        output = record.prediction if record.prediction is not None else record.y
        assert output is not None
        return output[record.known]

    def with_knots(self, record: Record) -> Any:
        if self.knots is not None:
            return self
        watched = self.watched(record)
        widest = float(np.quantile(np.abs(watched - watched.mean()), WIDEST))
        widths = widest * np.arange(1, N_PLAYS + 1) / N_PLAYS
        return self.with_choices(knots=tuple(widths.tolist()))

    def with_more_knots(self) -> FreeHysteresis:
        """The same: its knots are the plays themselves."""
        return self

    def shaped(self, signal: Any, record: Record, curve: Callable[..., np.ndarray]) -> Any:
        """With plays that have the weights of the curve."""
        gaps = np.asarray(self.knots)
        weights = self.curve.weights(curve(gaps))

        def behind(x: np.ndarray) -> np.ndarray:
            return x - _kernels.greybox.stops_summed(_kernels.gate(x), gaps, weights)

        if self.where != "command":
            return behind(signal)
        whole = signal.position + differentiated(signal.rate, record.dt)
        return signal._replace(position=behind(whole), rate=np.zeros_like(signal.rate))
