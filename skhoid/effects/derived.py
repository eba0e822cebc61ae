"""Signals that follow from error, target and controlled output: what a free form may be over.

Their names are reserved as channels of effects: ``FreeGain(channel="size of e")``. A record
computes them of its own channels, so in a simulated loop they follow the simulated error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .parameter import Dimension, E, S

WINDOW = 2.0  # s, over which the size of an error is felt; in units of the record's time


@dataclass(frozen=True)
class Derived:
    """A signal that follows from the channel of a role, or from its rate ``per_second``.

    ``of(signal, window)`` computes it, with the window in samples; ``words`` name it, and ``short``
    is its name on an axis.
    """

    role: str
    words: str
    short: str
    of: Callable[[np.ndarray, int], np.ndarray]
    per_second: bool = False

    @property
    def dimension(self) -> Dimension:
        """Its unit."""
        own = E if self.role == "e" else Dimension.of_role(self.role)
        return own / S if self.per_second else own


def _itself(signal: np.ndarray, window: int) -> np.ndarray:
    return signal


def _size(signal: np.ndarray, window: int) -> np.ndarray:
    return np.abs(signal)


def _running_size(signal: np.ndarray, window: int) -> np.ndarray:
    """Root mean square over the last ``window`` samples, or over those that there are."""
    total = np.cumsum(signal**2, axis=0)
    total[window:] -= total[:-window].copy()
    count = np.minimum(np.arange(1, len(signal) + 1), window)
    return np.asarray(np.sqrt(np.maximum(total, 0.0) / count[:, None]))


DERIVED = {
    "|e|": Derived("e", "the size of the error", "size of the error |e|", _size),
    "size of e": Derived(
        "e",
        "the running size of the error",
        "running size of the error (rms of 2 s)",
        _running_size,
    ),
    "de/dt": Derived("e", "the rate of the error", "rate of the error", _itself, True),
    "|de/dt|": Derived("e", "the speed of the error", "speed of the error |de/dt|", _size, True),
    "|df_t/dt|": Derived(
        "f_t", "the speed of the target", "speed of the target |df_t/dt|", _size, True
    ),
    "x": Derived("x", "the controlled output x", "controlled output x", _itself),
    "|x|": Derived("x", "the size of the controlled output x", "size |x|", _size),
}


def words_of(channel: str) -> str:
    """A channel in a sentence: a derived one by its meaning, any other by its name."""
    return DERIVED[channel].words if channel in DERIVED else channel


def dimension_of(channel: str | None) -> Dimension:
    """The unit of a channel, or of what follows from one."""
    return DERIVED[channel].dimension if channel in DERIVED else Dimension.of_channel(channel)
