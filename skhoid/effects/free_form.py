"""The base of free forms: effects whose shape is estimated, for physics that has no name yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

from .. import _kernels
from .base import Effect
from .entry import Argument
from .parameter import Dimension, Parameter
from .record import Record

LEVEL, SLOPE = 0, 1  # degrees of the polynomials that have no roughness


@dataclass(frozen=True)
class SmoothCurve:
    """Natural cubic splines with given knots, linear beyond the outermost.

    Demmler and Reinsch's basis: the level and the slope, if they are in ``kept``, and then ever
    rougher curves, orthogonal at the knots and of mean square one there. Where knots are quantiles
    of a signal, that is the mean square over the signal. Curves whose coefficients have variances
    proportional to 1 / roughness are as likely as penalised splines make them, whose penalty is the
    integral of the squared second derivative.

    Parameters
    ----------
    knots : tuple of float
        At least four, rising.
    kept : tuple of int
        Which of LEVEL and SLOPE belong to the curves; what a model has already does not.
    odd : bool
        Whether curve(-x) = -curve(x), given at knots from zero on; it may bend sharply at zero.

    References
    ----------
    Demmler and Reinsch, Oscillation matrices with spline smoothing (1975). Wood, Generalized
    additive models (2017), section 5.3.
    """

    knots: tuple[float, ...]
    kept: tuple[int, ...] = (LEVEL, SLOPE)
    odd: bool = False

    @property
    def _found(self) -> tuple[np.ndarray, np.ndarray]:
        return _make_basis(self.knots, self.kept)

    @property
    def basis(self) -> np.ndarray:
        """Values at the knots of each curve of the basis, of shape (n_knots, n_coefficients)."""
        return self._found[0]

    @property
    def roughness(self) -> np.ndarray:
        """Of each curve of the basis, relative to the smoothest one that is not a line."""
        return self._found[1]

    def __call__(self, values: np.ndarray, at: np.ndarray) -> np.ndarray:
        """A curve, or several as columns, with ``values`` at the knots, at any points."""
        if self.odd:
            tail = (...,) + (None,) * (np.ndim(values) - 1)
            above = replace(self, odd=False)(np.asarray(values), np.abs(at))
            return np.asarray(np.sign(at)[tail] * (above - np.asarray(values)[0]))
        at, pieces = np.asarray(at, dtype=float), _make_pieces(self.knots)
        several = np.reshape(values, (len(self.knots), -1)).T
        flat, knots = _kernels.gate(at.ravel()), _kernels.gate(self.knots)
        found = [
            _kernels.greybox.along(flat, knots, _kernels.gate(pieces @ one)) for one in several
        ]
        return np.stack(found, axis=-1).reshape(at.shape + np.shape(values)[1:])


@lru_cache(maxsize=64)
def _make_pieces(knots: tuple[float, ...]) -> np.ndarray:
    """Cubic pieces by each value at the knots, (4, n_knots + 1, n_knots), linear at both ends."""
    points = np.asarray(knots)
    spline = CubicSpline(points, np.eye(points.size), bc_type="natural")
    ends = points[[0, -1]]
    lines = np.stack([np.zeros((2, points.size))] * 2 + [spline(ends, 1), spline(ends)])
    return np.concatenate([lines[:, :1], spline.c, lines[:, 1:]], axis=1)


@lru_cache(maxsize=64)
def _make_basis(knots: tuple[float, ...], kept: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Values at the knots of each curve of the basis, and their roughness."""
    points = np.asarray(knots)
    span = points[-1] - points[0]
    at = (points - points.mean()) / span
    bends = CubicSpline(at, np.eye(at.size), bc_type="natural")(at, 2)
    widths = np.diff(at)
    mass = np.diag(np.r_[widths, 0.0] + np.r_[0.0, widths]) / 3
    mass += (np.diag(widths, 1) + np.diag(widths, -1)) / 6
    roughness, basis = eigh(bends.T @ mass @ bends, np.eye(at.size) / at.size)
    flat = [np.ones(at.size), at / np.sqrt(np.mean(at**2))]
    columns = [flat[degree] for degree in kept] + list(basis.T[2:])
    relative = roughness[2:] / roughness[2]
    return np.stack(columns, axis=1), np.r_[np.zeros(len(kept)), relative]


N_KNOTS = 11
FEWEST = 4  # knots of a curve
TAIL = 0.005  # share of a signal beyond the outermost knots
USUAL = 0.3  # size of a curve, relative to the scale of its parameters, before data say more


class FreeForm(Effect):
    """Base of effects that are a smooth curve, whose coefficients are estimated with a penalty.

    The curve is a natural cubic spline. Its roughness has a prior variance, ``spread`` squared,
    that is chosen by marginal likelihood: a straight line if the data show no more. A subclass says
    what the curve is over (``watched``), in what units (``abscissa``, ``ordinate``), and what it
    does (``shaped``, in place of ``apply``).

    Attributes
    ----------
    free_form : bool
        True: no search takes it for a name.
    kept : tuple of int
        Which of level (0) and slope (1) are part of the curve; others are the model's own.
    over : str
        What the curve is a function of, for people.
    y_word : str
        What the curve gives, for people.
    abscissa, ordinate : Dimension
        Units of the curve.
    largest, usual : float
        Greatest coefficients, and the size of a curve before data say more, relative to the scale
        of its unit.
    at_rest : float
        What to add to the curve where people see it: 1 for a factor.
    least : float
        Below which nothing changes, where people see the curve.
    shrinks : bool
        Whether level and slope are known to be small too.

    See Also
    --------
    Effect : The base class of all effects.

    Examples
    --------
    >>> from skhoid.effects import FreeGain
    >>> form = FreeGain(knots=(0.0, 10.0, 20.0, 30.0), values=(0.0, 0.1, 0.3, 0.2))
    >>> float(form.curve(form.values, 10.0).round(3))
    0.1
    """

    free_form: ClassVar[bool] = True
    y_word: ClassVar[str] = "departure"
    largest: ClassVar[float] = 50.0
    usual: ClassVar[float] = USUAL
    at_rest: ClassVar[float] = 0.0
    least: ClassVar[float] = -np.inf
    shrinks: ClassVar[bool] = False
    kept: ClassVar[tuple[int, ...]] = (LEVEL, SLOPE)
    arguments = {
        "knots": Argument(
            "Where the curve is given; None means quantiles of what it is a function of.",
            "tuple of float or None",
        ),
        "values": Argument("The curve at the knots; None estimates it.", "tuple of float or None"),
        "spread": Argument(
            "Size of the curve's smoothest part, that decides how smooth it is; None chooses it by "
            "likelihood.",
            "float or None",
        ),
    }

    @property
    def over(self) -> str:
        """What the curve is a function of: ``"e"``, ``"time"``, the name of a channel ..."""
        raise NotImplementedError

    @property
    def abscissa(self) -> Dimension:
        """Unit of what the curve is a function of."""
        raise NotImplementedError

    @property
    def ordinate(self) -> Dimension:
        """Unit of the curve."""
        raise NotImplementedError

    @property
    def sentence(self) -> str:
        """Where it acts and on what it depends, in words."""
        raise NotImplementedError

    def sentence_in(self, domain: str) -> str:
        """The same of what was recorded: a machine has no error that it sees, and no command."""
        return self.sentence

    def watched(self, record: Record) -> np.ndarray:
        """Samples of what the curve is a function of, for its knots."""
        raise NotImplementedError

    def shaped(self, signal: Any, record: Record, curve: Any) -> Any:
        """What becomes of the signal, with the curve as a function of arrays."""
        raise NotImplementedError

    @property
    def ends(self) -> tuple[float, float]:
        """Where the curve begins and ends, for people."""
        assert self.knots is not None
        return self.knots[0], self.knots[-1]

    @property
    def curve(self) -> SmoothCurve:
        """The family of curves."""
        assert self.knots is not None
        return SmoothCurve(tuple(self.knots), self.kept, bool(getattr(self, "odd", False)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        if self.values is not None or self.knots is None:
            return ()
        count = self.curve.basis.shape[1]
        unit = self.ordinate
        return tuple(
            Parameter(f"c{i}", unit, -self.largest, self.largest, (0.0,), f"curve {i} of the basis")
            for i in range(count)
        )

    @property
    def free(self) -> list[Parameter]:
        return list(self.parameters)

    @property
    def fixed(self) -> dict[str, float]:
        return {}

    @property
    def neutral(self) -> Mapping[str, float]:  # type: ignore[override]
        return {p.name: 0.0 for p in self.parameters}

    def spreads(self, scales: Mapping[str, float]) -> dict[str, float]:
        if self.values is not None or self.knots is None:
            return {}
        roughness = self.curve.roughness
        if self.shrinks:
            roughness = np.maximum(roughness, 1.0)
        rough = [(p.name, r) for p, r in zip(self.parameters, roughness, strict=True) if r > 0.0]
        return {
            name: (self.usual * scales[name] if self.spread is None else self.spread)
            / float(np.sqrt(r))
            for name, r in rough
        }

    def variants(self, record: Record) -> list[Effect]:
        return [self.with_knots(record)]

    def with_knots(self, record: Record) -> Any:
        """The form with knots at quantiles of what the curve is a function of."""
        if self.knots is not None:
            return self
        return self.with_choices(knots=quantile_knots(self.watched(record)))

    def with_more_knots(self) -> Any:
        """The form with a further knot half-way between any two."""
        knots = np.asarray(self.knots)
        knots = np.sort(np.r_[knots, (knots[1:] + knots[:-1]) / 2])
        return self.with_choices(knots=tuple(knots.tolist()))

    def coefficients(self, at_knots: np.ndarray) -> dict[str, float]:
        """Those of the curve nearest to values at the knots."""
        found = np.linalg.lstsq(self.curve.basis, at_knots, rcond=None)[0]
        return {p.name: float(c) for p, c in zip(self.parameters, found, strict=True)}

    def with_values(self, values: Mapping[str, float]) -> Any:
        if self.values is not None:  # given, so nothing was estimated
            return self
        coefficients = np.array([values[p.name] for p in self.parameters])
        return self.with_choices(values=tuple((self.curve.basis @ coefficients).tolist()))

    def apply(self, signal: Any, record: Record, **values: float) -> Any:
        curve = self.curve
        if self.values is None:
            at_knots = curve.basis @ [values[f"c{i}"] for i in range(len(values))]
        else:
            at_knots = np.asarray(self.values)
        return self.shaped(signal, record, lambda at: curve(at_knots, at))

    def design(self, at: np.ndarray) -> np.ndarray:
        """Values at points by each coefficient, of shape (n_points, n_coefficients)."""
        return self.curve(self.curve.basis, at)


def quantile_knots(signal: np.ndarray) -> tuple[float, ...]:
    """Knots at quantiles of a signal, none closer than a hundredth of their range."""
    levels = np.linspace(TAIL, 1 - TAIL, N_KNOTS)
    found = np.quantile(signal, levels)
    least = 0.01 * (found[-1] - found[0])
    kept = [found[0]]
    for value in found[1:]:
        if value - kept[-1] >= least > 0.0:
            kept.append(value)
    if len(kept) < FEWEST and found[-1] > found[0]:  # a channel of a few levels
        kept = np.linspace(found[0], found[-1], FEWEST).tolist()
    return tuple(float(value) for value in kept)
