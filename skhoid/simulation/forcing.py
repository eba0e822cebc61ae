"""Forcing functions: sums of sinusoids (Eq. 26)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import count
from typing import Any

import numpy as np
from sklearn.utils import check_random_state

from ..human.variation import as_floats

# Table I of the thesis, after Zaal (2016).
_MULTIPLES = (3, 5, 8, 13, 22, 34, 53, 86, 139, 229)
_AMPLITUDES = (1.186, 1.121, 0.991, 0.756, 0.447, 0.245, 0.123, 0.061, 0.036, 0.025)
_PHASES = (-0.753, 1.564, 0.588, -0.546, 0.674, -1.724, -1.963, -2.189, 0.875, 0.604)


@dataclass(frozen=True)
class Multisine:
    """Sum of sinusoids (Eq. 26); the target of Table I by default.

    f(t) = sum_k A(k) sin(omega(k) t + phi(k)), omega(k) = 2 pi n(k) / T_m. Time starts at the
    beginning of the measurement window.

    Parameters
    ----------
    multiples : sequence of int, default: Table I
        n(k), distinct whole multiples of the base frequency 2 pi / T_m.
    amplitudes : sequence of float, default: Table I
        A(k), in deg or the unit of the displayed signals.
    phases : sequence of float, default: Table I
        phi(k) in rad.
    period : float, default=81.92
        T_m in s.

    Examples
    --------
    >>> from skhoid import Multisine
    >>> f_t = Multisine()
    >>> f_t.omega[[0, -1]].round(3)
    array([ 0.23 , 17.564])
    >>> round(f_t.crest_factor(), 3)
    2.693
    >>> Multisine(multiples=[5, 11], amplitudes=[1.0, 0.5], phases=[0.0, 1.0], period=30.0)(0.0)
    np.float64(0.420...)
    """

    multiples: tuple[int, ...] = _MULTIPLES
    amplitudes: tuple[float, ...] = _AMPLITUDES
    phases: tuple[float, ...] = _PHASES
    period: float = 81.92

    def __post_init__(self) -> None:
        for name in ("multiples", "amplitudes", "phases"):
            values = tuple(np.asarray(getattr(self, name)).tolist())
            if not values or not np.isfinite(values).all():
                raise ValueError(f"Multisine: {name} must be finite numbers; got {values}.")
            object.__setattr__(self, name, values)
        sizes = (len(self.multiples), len(self.amplitudes), len(self.phases))
        if len(set(sizes)) > 1:
            raise ValueError(
                "Multisine: multiples, amplitudes and phases must have the same length; got "
                "{}, {} and {}.".format(*sizes)
            )
        if any(n < 1 or n != int(n) for n in self.multiples):
            raise ValueError(
                f"Multisine: multiples of the base frequency 2 pi / period must be whole "
                f"numbers, at least 1; got {self.multiples}."
            )
        if len(set(self.multiples)) < len(self.multiples):
            raise ValueError(f"Multisine: a multiple occurs twice in {self.multiples}.")
        if not (np.isfinite(self.period) and self.period > 0):
            raise ValueError(f"Multisine: period must be positive, in s; got {self.period!r}.")
        object.__setattr__(self, "multiples", tuple(int(n) for n in self.multiples))

    def __repr__(self) -> str:
        shown = {f.name: getattr(self, f.name) for f in fields(self)}
        parts = [f"{f.name}={shown[f.name]!r}" for f in fields(self) if shown[f.name] != f.default]
        return f"Multisine({', '.join(parts)})"

    @property
    def omega(self) -> np.ndarray:
        """Excited frequencies in rad/s, in the order of ``multiples``."""
        return 2 * np.pi * np.array(self.multiples) / self.period

    def __call__(self, t: Any) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        return np.sin(t[..., None] * self.omega + np.array(self.phases)) @ np.array(self.amplitudes)

    def sample(self, first: int, n_samples: int, sampling_rate: float) -> np.ndarray:
        """Values on the grid k / f_s, of shape (n_samples,).

        Parameters
        ----------
        first : int
            First k; 0 is the beginning of the measurement window.
        n_samples : int
            Number of samples.
        sampling_rate : float
            f_s in Hz.
        """
        if self.omega.max() >= np.pi * sampling_rate:
            raise ValueError(
                f"Multisine: the line at {self.omega.max():.4g} rad/s is not below Nyquist, "
                f"{np.pi * sampling_rate:.4g} rad/s at {sampling_rate:g} Hz. Sample faster, or "
                "leave it out."
            )
        period = self.period * sampling_rate
        whole = round(period)
        if abs(period - whole) > 1e-9 * period or n_samples < whole:
            return self(np.arange(first, first + n_samples) / sampling_rate)
        return np.resize(np.roll(_sample_period(self, whole), -first), n_samples)

    def crest_factor(self) -> float:
        """Peak over root mean square, in one period at 100 Hz or 20 times the highest line."""
        rate = max(100.0, 20 * self.omega.max() / (2 * np.pi))
        f = self(np.arange(round(self.period * rate)) / rate)
        return float(np.abs(f).max() / np.sqrt(np.mean(f**2)))

    def with_random_phases(
        self, random_state: Any = None, *, max_crest_factor: float | None = None
    ) -> Multisine:
        """The same lines with phases drawn uniformly from (-pi, pi].

        Parameters
        ----------
        random_state : int, RandomState, Generator or None, default=None
            Source of the phases.
        max_crest_factor : float or None, default=None
            Draw until the crest factor is at most this, in up to 1000 draws.
        """
        is_new = isinstance(random_state, np.random.Generator)
        random = random_state if is_new else check_random_state(random_state)
        lowest = np.inf
        for _ in range(1 if max_crest_factor is None else 1000):
            drawn = replace(self, phases=tuple(random.uniform(-np.pi, np.pi, len(self.phases))))
            if max_crest_factor is None or (crest := drawn.crest_factor()) <= max_crest_factor:
                return drawn
            lowest = min(lowest, crest)
        raise ValueError(
            f"Multisine: none of 1000 draws of phases has a crest factor of {max_crest_factor} or "
            f"less; the lowest is {lowest:.2f}. Allow a larger one, or add lines."
        )

    def interleaved(self, *, scale: float = 1.0, random_state: Any = None) -> Multisine:
        """A second forcing function on lines just above these, with random phases.

        The lines are shifted by the smallest distance at which none falls on one of these:
        responses of an operator to two inputs, say to e and x, need two forcing functions with
        close lines.

        Parameters
        ----------
        scale : float, default=1.0
            Factor on the amplitudes.
        random_state : int, RandomState, Generator or None, default=None
            Source of the phases.

        Examples
        --------
        >>> from skhoid import Multisine
        >>> Multisine().interleaved(random_state=0).multiples
        (4, 6, 9, 14, 23, 35, 54, 87, 140, 230)
        """
        own = set(self.multiples)
        offset = next(d for d in count(1) if own.isdisjoint(n + d for n in own))
        second = replace(
            self,
            multiples=tuple(n + offset for n in self.multiples),
            amplitudes=tuple(scale * a for a in self.amplitudes),
        )
        return second.with_random_phases(random_state)


class Samples:
    """A forcing function given by its samples, as a value that can be compared."""

    def __init__(self, values: Any) -> None:
        self.values = as_floats(values, "values").copy()
        self.values.flags.writeable = False

    def __repr__(self) -> str:
        return f"Samples({self.values.size})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Samples) and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return hash(self.values.tobytes())


@lru_cache(maxsize=16)
def _sample_period(multisine: Multisine, n_samples: int) -> np.ndarray:
    return multisine(np.arange(n_samples) * (multisine.period / n_samples))
