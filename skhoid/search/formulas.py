"""Short formulas for curves, and which of them a free form's curve can be."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import expit
from scipy.stats import norm

from ..effects.free_form import FreeForm
from ..effects.parameter import ONE, Dimension
from ..effects.record import Record
from .likeness import Likeness

LEVEL = 0.95
SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)  # starts of a formula's size, relative to the signal
SCALES = (0.05, 0.15, 0.4, 1.0)  # starts of its other numbers, relative to the range
NAMES = ("size", "knee", "tau", "middle", "length", "period", "begin")  # in the order of values
SIZE = "size of what is added"
MAPPED = ("input", "output", "command")
LARGEST = 30.0  # size of a formula, relative to the signal


@dataclass(frozen=True)
class Formula:
    """A short formula of a signal or of time."""

    code: str
    text: str
    powers: tuple[int, ...]
    meanings: tuple[str, ...]
    signed: bool = False
    whole: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, as ``code`` has them."""
        return tuple(name for name in NAMES if re.search(rf"\b{name}\b", self.code))

    def function(self, at: np.ndarray, *values: Any) -> np.ndarray:
        """The formula at points, for values of its parameters."""
        return np.asarray(_compiled(self.code, self.names)(at, *values))


@cache
def _compiled(code: str, names: tuple[str, ...]) -> Callable[..., np.ndarray]:
    """A code of the table below as a function of the abscissa and the parameters."""
    abscissa = "t" if re.search(r"\bt\b", code) else "x"
    made: Callable[..., np.ndarray] = eval(
        f"lambda {', '.join([abscissa, *names])}: {code}", {"np": np, "expit": expit}
    )
    return made


def _sized(code: str, text: str, powers: tuple[int, ...], *meanings: str) -> Formula:
    """A formula of some size; one with a knee of any sign is not the same to either side."""
    signed = "(x - knee" in code
    return Formula(f"size * {code}", f"size {text}", powers, (SIZE, *meanings), signed)


def _whole(code: str, text: str, meaning: str) -> Formula:
    """A formula in place of the error, the command or the output."""
    return Formula(f"{code} - x", f"{text} - x", (0,), (meaning,), whole=True)


BENDS, FADES = "where it bends", "where it fades"
HINGE = "np.sign(x) * np.maximum(np.abs(x) - knee, 0.0)"
LOG, LOG_TEXT = "np.sign(x) * np.log1p(np.abs(x) / knee)", "sign(x) log(1 + |x| / knee)"
BELL, BELL_TEXT = "x * np.exp(-((x / knee) ** 2))", "x exp(-(x / knee)^2)"
OF_SIGNALS = (
    _sized("x**3", "x^3", (3,)),
    _sized("x * np.abs(x)", "x |x|", (2,)),
    _sized("np.abs(x)", "|x|", (1,)),
    _sized("x**2", "x^2", (2,)),
    _sized("np.maximum(x, 0.0) ** 2", "max(x, 0)^2", (2,)),
    _sized("np.minimum(x, 0.0) ** 2", "min(x, 0)^2", (2,)),
    _sized(HINGE, "sign(x) max(|x| - knee, 0)", (1, 1), BENDS),
    _sized("np.tanh(x / knee)", "tanh(x / knee)", (0, 1), BENDS),
    _sized(LOG, LOG_TEXT, (0, 1), BENDS),
    _sized(BELL, BELL_TEXT, (1, 1), FADES),
    _sized("np.maximum(x - knee, 0.0)", "max(x - knee, 0)", (1, 1), BENDS),
    _sized("np.minimum(x - knee, 0.0)", "min(x - knee, 0)", (1, 1), BENDS),
)
WHOLE = (
    _whole(f"knee * {LOG}", f"knee {LOG_TEXT}", BENDS),
    _whole("knee * np.tanh(x / knee)", "knee tanh(x / knee)", BENDS),
    _whole(BELL, BELL_TEXT, FADES),
)
STEP = Formula(
    "size * np.clip((t - begin) / 0.1, 0.0, 1.0)",
    "a step of size at begin",
    (0, 1),
    (SIZE, "time of the step"),
)
CHANGE = Formula(
    "size * expit((t - middle) / length)",
    "size / (1 + exp(-(t - middle) / length))",
    (0, 1, 1),
    (SIZE, "middle of the change", "a quarter of its length"),
)
OF_TIME = (
    _sized("t", "t", (1,)),
    _sized("np.exp(-t / tau)", "exp(-t / tau)", (0, 1), "time constant"),
    STEP,
    CHANGE,
    _sized(
        "np.sin(2 * np.pi * (t - begin) / period)",
        "sin(2 pi (t - begin) / period)",
        (0, 1, 1),
        "period",
        "time at which it rises through zero",
    ),
)


@dataclass(frozen=True)
class Fitted:
    """A formula with numbers at which it lies within a shape's band."""

    formula: Formula
    values: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    distance: float

    @property
    def numbers(self) -> dict[str, float]:
        """Values by name, in the units of the data."""
        return dict(zip(self.formula.names, self.values, strict=True))

    @property
    def sentence(self) -> str:
        """The formula and its numbers in words."""
        numbers = ", ".join(f"{name} = {value:.4g}" for name, value in self.numbers.items())
        return f"A short formula lies within the band: {self.formula.text} with {numbers}."

    def dimensions(self, form: FreeForm) -> tuple[Dimension, ...]:
        """Of the parameters, at the place of a free form."""
        size, *others = self.formula.powers
        first = form.ordinate / form.abscissa**size if size else form.ordinate
        return (first, *(form.abscissa**power if power else ONE for power in others))


def formulas_for(form: FreeForm) -> Sequence[Formula]:
    """Formulas that are tried for a free form; none for a memory of what was."""
    if form.over == "lag" or form.name == "free_hysteresis":
        return ()
    if form.over == "time":
        return OF_TIME
    return (*OF_SIGNALS, *WHOLE) if form.place in MAPPED else OF_SIGNALS


def find_formula(form: FreeForm, curve: pd.DataFrame, dof: float, record: Record) -> Fitted | None:
    """The likeliest formula that lies within the band of a curve everywhere, by BIC; or None."""
    grid = curve.index.to_numpy(dtype=float)
    like = Likeness.of(form, grid, curve["value"].to_numpy(), record)
    half = ((curve["high"] - curve["low"]) / 2).to_numpy()
    dof = max(dof, 1.0)
    sd = half / norm.ppf((1 + LEVEL ** (1 / dof)) / 2)
    best, least = None, np.inf
    for formula in formulas_for(form):
        low, high, starts = list_starts(formula, like)

        def departure(values: np.ndarray, formula: Formula = formula) -> np.ndarray:
            return formula.function(like.at, *values)

        fit = like.fitted(departure, starts, low, high)
        if fit is None or not (np.abs(fit.curve - like.value) <= half).all():
            continue
        misfit = np.interp(like.points, grid, (fit.curve - like.value) / sd)
        cost = dof * float(np.mean(misfit**2)) + fit.acts.size * np.log(len(form.knots or ()))
        if cost < least:
            least = cost
            ends = tuple(low.tolist()), tuple(high.tolist())
            best = Fitted(formula, tuple(np.asarray(fit.values).tolist()), *ends, fit.distance)
    return best


def list_starts(formula: Formula, like: Likeness) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds and starts of a formula's parameters, in the units of the data."""
    span = float(np.ptp(like.grid))
    reach = span if like.form.over == "time" else float(np.abs(like.grid).max())
    size = reach if like.form.ordinate == like.form.abscissa else float(np.abs(like.value).max())
    if formula.whole:
        knees = np.array([[s * reach] for s in SCALES])
        return np.array([1e-3 * reach]), np.array([100.0 * reach]), knees
    size = size / reach ** formula.powers[0]
    if like.form.over != "time" and like.form.place in MAPPED:
        size = reach ** (1 - formula.powers[0])
    n_more = len(formula.powers) - 1
    least = -reach if formula.signed else 1e-3 * reach
    low = np.array([-LARGEST * size, *[least] * n_more])
    high = np.array([LARGEST * size, *[(1.0 if formula.signed else 10.0) * reach] * n_more])
    scales = [s * reach for s in SCALES]
    if formula.signed:
        scales = [sign * s for s in scales for sign in (1.0, -1.0)]
    signs = (1.0,) if "period" in formula.names else (1.0, -1.0)  # begin has the sign of a wave
    low[0] = 0.0 if len(signs) == 1 else low[0]
    starts = [
        [sign * a * size, *m]
        for a in SIZES
        for sign in signs
        for m in product(scales, repeat=n_more)
    ]
    return low, high, np.array(starts)
