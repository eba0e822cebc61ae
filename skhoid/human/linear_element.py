"""``LinearElement``: a controlled element of any order, continuous or discrete, also as text."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import Any, NoReturn

import numpy as np
from scipy.linalg import logm
from scipy.signal import cont2discrete, lfilter, lfilter_zi, ss2tf, tf2ss

EXAMPLES = '"1/s", "1/(s(s+1))", "90/(s^2+6s)", "2(s+3)/(s^2 (s+0.5))"'
LARGEST_POWER = 20
NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
TOKEN = re.compile(rf"{NUMBER.pattern}|\*\*|\S")
VARIABLES = ("s", "z")
IMPLIED = "@"  # stands for a product that is not written, and binds as * and / do
Ratio = tuple[np.ndarray, np.ndarray]  # coefficients of numerator and denominator


def is_number(text: str) -> bool:
    """Whether a text is just a number, which counts as a gain and not as a transfer function."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def parse(text: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Numerator, denominator (highest power first) and variable ("s", "z" or "") of a text."""
    tokens = TOKEN.findall(text)
    if not tokens:
        _refuse(text, "it is empty")
    for token in tokens:
        if token[0].isalpha() and token not in VARIABLES:
            _refuse(text, f"{token!r} is unknown: use only s (or z) and numbers, no names of gains")
    if {*VARIABLES} <= {*tokens}:
        _refuse(text, "it has both s and z")
    parts = []
    for before, token in zip(["", *tokens], tokens, strict=False):
        number = NUMBER.fullmatch(token)
        if (number or token in ("(", *VARIABLES)) and (
            before in (")", *VARIABLES) or NUMBER.fullmatch(before)
        ):
            parts.append(IMPLIED)
        parts.append(f"{token}.0" if token.isdigit() else "**" if token == "^" else token)
    source = " ".join(parts)
    try:
        numerator, denominator = _evaluate(ast.parse(source, mode="eval").body, source)
    except (SyntaxError, TypeError) as error:
        what = error.msg if isinstance(error, SyntaxError) else str(error)
        _refuse(text, what)
    while min(numerator.size, denominator.size) > 1 and numerator[-1] == denominator[-1] == 0:
        numerator, denominator = numerator[:-1], denominator[:-1]
    return numerator, denominator, next((v for v in VARIABLES if v in tokens), "")


def _refuse(text: str, what: str) -> NoReturn:
    raise ValueError(
        f"The controlled element {text!r} cannot be read: {what}. Write a ratio of "
        f"polynomials in s, or in z with dt, such as {EXAMPLES}."
    )


def _evaluate(node: ast.AST, source: str) -> Ratio:
    """A sum, product or power of ratios of polynomials; a TypeError says what is none."""
    one = np.ones(1)
    if isinstance(node, ast.Constant):
        return np.array([float(node.value)]), one  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return np.array([1.0, 0.0]), one
    if isinstance(node, ast.UnaryOp):
        top, bottom = _evaluate(node.operand, source)
        return (-top if isinstance(node.op, ast.USub) else top), bottom
    if not isinstance(node, ast.BinOp):
        raise TypeError("it is no formula")
    top, bottom = _evaluate(node.left, source)
    n, d = _evaluate(node.right, source)
    if isinstance(node.op, ast.Pow):
        power = float(n[0]) if n.size == d.size == 1 else -1.0
        if not (power.is_integer() and 0 <= power <= LARGEST_POWER):
            raise TypeError(f"a power must be a whole number up to {LARGEST_POWER}")
        tops, bottoms = [top] * int(power), [bottom] * int(power)
        return reduce(np.polymul, tops, one), reduce(np.polymul, bottoms, one)
    if isinstance(node.op, (ast.Add, ast.Sub)):
        n = n if isinstance(node.op, ast.Add) else -n
        if np.array_equal(bottom, d):
            return np.polyadd(top, n), d
        return np.polyadd(np.polymul(top, d), np.polymul(n, bottom)), np.polymul(bottom, d)
    left = node.left
    divided = isinstance(left, ast.BinOp) and isinstance(left.op, ast.Div)
    if (
        isinstance(node.op, ast.MatMult)
        and divided
        and source[(left.end_col_offset or 0) + 1] != ")"
    ):
        raise TypeError(
            "it is not clear whether what follows a denominator belongs to it: write "
            '"1/(s(s+1))" or "(1/s)(s+1)"'
        )
    if isinstance(node.op, ast.Div):
        if not np.any(n):
            raise TypeError("it divides by zero")
        n, d = d, n
    return np.polymul(top, n), np.polymul(bottom, d)


def write(numerator: tuple[float, ...], denominator: tuple[float, ...], variable: str) -> str:
    """A transfer function as text, its denominator with poles at zero in front."""
    n_zero = 0
    while n_zero < len(denominator) - 1 and denominator[-1 - n_zero] == 0.0:
        n_zero += 1
    rest = denominator[: len(denominator) - n_zero]
    power = "" if n_zero == 0 else variable if n_zero == 1 else f"{variable}^{n_zero}"
    above = _write_polynomial(numerator, variable)
    below = power
    if len(rest) > 1:
        below = f"({_write_polynomial(rest, variable)})"
        below = f"({power} {below})" if power else below
    several = sum(c != 0.0 for c in numerator) > 1
    if not below:
        return above
    return f"({above})/{below}" if several else f"{above}/{below}"


def _write_polynomial(coefficients: tuple[float, ...], variable: str) -> str:
    terms = []
    for i, c in enumerate(coefficients):
        power = len(coefficients) - 1 - i
        if c == 0.0:
            continue
        name = "" if power == 0 else variable if power == 1 else f"{variable}^{power}"
        size = f"{abs(c):.4g}"
        number = name if name and size == "1" else f"{size} {name}".rstrip()
        terms.append(("- " if c < 0 else "+ ") + number)
    joined = " ".join(terms) or "+ 0"
    return joined[2:] if joined.startswith("+") else f"-{joined[2:]}"


TINY = 1e-12  # relative to the largest coefficient: rounding
# Numerator, denominator and, of a discrete one, the sampling time in seconds.
Coefficients = tuple[tuple[float, ...], tuple[float, ...], float | None]


def read_coefficients(system: Any) -> Coefficients:
    """Numerator, denominator and sampling time of a system of one input and one output."""
    if hasattr(system, "constant_coefficients"):  # a ControlledElement
        return system.constant_coefficients()
    if all(hasattr(system, name) for name in "ABCD"):
        return _read_state_space(system)
    if hasattr(system, "to_tf"):  # of SciPy
        system = system.to_tf()
    if hasattr(system, "num") and hasattr(system, "den"):
        return (
            tuple(_read_only(system.num)),
            tuple(_read_only(system.den)),
            _read_sampling_time(system),
        )
    raise TypeError(
        f"controlled_element must be a ControlledElement, a text such as {EXAMPLES}, or a transfer "
        f"function or state space of python-control or SciPy; got {system!r}."
    )


def _read_only(coefficients: Any) -> np.ndarray:
    """The coefficients of one input and one output, which python-control nests in lists."""
    while len(coefficients) == 1 and np.ndim(coefficients[0]) > 0:
        coefficients = coefficients[0]
    if np.ndim(coefficients[0]) > 0:
        raise ValueError(
            "controlled_element has several inputs or outputs. Give the part from u to x."
        )
    return np.asarray(coefficients, dtype=float)


def _read_sampling_time(system: Any) -> float | None:
    dt = getattr(system, "dt", None)
    if dt is True:
        raise ValueError(
            "controlled_element is discrete but has no sampling time. Make it with "
            "dt=..., in seconds."
        )
    return float(dt) if dt else None


def _read_state_space(system: Any) -> Coefficients:
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(system, name), dtype=float)) for name in "ABCD")
    if D.shape != (1, 1):
        raise ValueError(
            f"controlled_element has {D.shape[1]} inputs and {D.shape[0]} outputs. Give the part "
            "from u to x."
        )
    if not A.size:
        return (D[0, 0],), (1.0,), _read_sampling_time(system)
    top, bottom = ss2tf(A, B, C, D)
    poles = np.linalg.eigvals(A)
    if np.any(np.abs(poles) < TINY * max(1.0, np.abs(poles).max())):
        # Integrators, to which the characteristic polynomial gives the rounding of the others.
        poles = np.where(np.abs(poles) < TINY * max(1.0, np.abs(poles).max()), 0.0, poles)
        bottom = np.real(np.poly(poles))
    top = np.where(np.abs(top[0]) < TINY * np.abs(top).max(), 0.0, top[0])
    return tuple(top), tuple(bottom), _read_sampling_time(system)


SAME_CLOCK = 1e-6  # relative difference of two sampling times that are the same
ON_AXIS = 1e-9  # real part of a zero, relative to its size, that is on the stability limit


@dataclass(frozen=True)
class LinearElement:
    """Linear, constant controlled element: x = numerator / denominator u.

    Coefficients are in falling powers of s, or of z where ``dt`` is given; the denominator is
    stored with 1 in front. ``ControlledElement("1/s")`` gives one, as :meth:`of` does.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients; in units of x per unit of u, and seconds.
    dt : float or None, default=None
        Sampling time in seconds of a discrete element; None means a continuous one, with u held
        between samples.
    direct : bool, default=False
        Whether x(k) already responds to u(k): u(k) is held up to sample k, as in recordings whose
        program reads u, moves x, and then stores both. Otherwise u(k) is held from sample k on, and
        first moves x(k+1).

    Examples
    --------
    >>> from skhoid import LinearElement
    >>> element = LinearElement.of("90/(s^2 + 6s)")
    >>> element
    LinearElement(numerator=(90.0,), denominator=(1.0, 6.0, 0.0))
    >>> print(element)
    90/(s (s + 6))
    >>> b, a = LinearElement.of("1/s").discrete(dt=0.01)
    >>> b, a
    (array([0.  , 0.01]), array([ 1., -1.]))
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dt: float | None = None
    direct: bool = False

    def __post_init__(self) -> None:
        top, bottom = _check_coefficients(self.numerator), _check_coefficients(self.denominator)
        if not bottom.any():
            raise ValueError("LinearElement: the denominator is zero.")
        if top.size > bottom.size:
            raise ValueError(
                f"LinearElement: {self._text(top, bottom)} has more zeros than poles, "
                f"{top.size - 1} and {bottom.size - 1}, which no recorded system has. Are "
                "numerator and denominator exchanged?"
            )
        if self.dt is not None and not (np.isfinite(self.dt) and self.dt > 0):
            raise ValueError(f"LinearElement: dt must be positive, in seconds; got {self.dt!r}.")
        if self.direct and (self.dt is not None or top.size == bottom.size):
            raise ValueError(
                "LinearElement: direct=True is for continuous elements with more poles than "
                "zeros; for others the coefficients already say it."
            )
        object.__setattr__(self, "numerator", tuple(float(c) for c in top / bottom[0]))
        object.__setattr__(self, "denominator", tuple(float(c) for c in bottom / bottom[0]))
        if self.dt is not None:
            object.__setattr__(self, "dt", float(self.dt))

    def __repr__(self) -> str:
        more = "" if self.dt is None else f", dt={self.dt!r}"
        more += ", direct=True" if self.direct else ""
        return (
            f"LinearElement(numerator={self.numerator!r}, denominator={self.denominator!r}{more})"
        )

    def __str__(self) -> str:
        text = self._text(np.array(self.numerator), np.array(self.denominator))
        return text if self.dt is None else f"{text}, dt = {self.dt:g} s"

    def _text(self, top: np.ndarray, bottom: np.ndarray) -> str:
        return write(tuple(top), tuple(bottom), "s" if self.dt is None else "z")

    @classmethod
    def of(cls, system: Any, dt: float | None = None) -> LinearElement:
        """An element from any description of one.

        Parameters
        ----------
        system : str, LinearElement, ControlledElement, or object of python-control or SciPy
            ``"1/(s(s+1))"``; a transfer function, zeros and poles, or a state space with one input
            and one output; a :class:`~skhoid.ControlledElement` that does not vary.
        dt : float or None, default=None
            Sampling time in seconds, for a string in z.
        """
        if isinstance(system, str):
            return _read_text(system, dt)
        if isinstance(system, LinearElement):
            return system
        return cls(*read_coefficients(system))

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.denominator) - 1

    @property
    def poles(self) -> np.ndarray:
        """Roots of the denominator, in rad/s where it is continuous."""
        return np.roots(self.denominator)

    @property
    def zeros(self) -> np.ndarray:
        """Roots of the numerator."""
        return np.roots(self.numerator)

    @property
    def constants(self) -> tuple[float, float] | None:
        """K_c and omega_b of an element K_c/(s (s + omega_b)), None of others."""
        plain = self.dt is None and not self.direct
        if not plain or len(self.numerator) != 1 or len(self.denominator) != 3:
            return None
        _, omega_b, rest = self.denominator
        K_c = self.numerator[0]
        return (K_c, omega_b) if rest == 0.0 and K_c >= 0 and omega_b >= 0 else None

    def frequency_response(self, omega: Any, t: float = 0.0) -> np.ndarray:
        """x/u at frequencies; infinite at an undamped pole.

        Parameters
        ----------
        omega : array-like of shape (n_frequencies,)
            Frequencies in rad/s.
        t : float, default=0.0
            Not used: the element is constant.
        """
        s = 1j * np.asarray(omega, dtype=float)
        q = s if self.dt is None else np.exp(s * self.dt)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.polyval(self.numerator, q) / np.polyval(self.denominator, q)

    def discrete(self, dt: float, hold: str = "zoh") -> tuple[np.ndarray, np.ndarray]:
        """The pulse transfer function x = b/a u on a grid of samples.

        Parameters
        ----------
        dt : float
            Sampling time in seconds.
        hold : {"zoh", "foh"}, default="zoh"
            Whether u is constant or a straight line between samples.

        Returns
        -------
        b, a : ndarray of shape (order + 1,)
            Exact coefficients of z^0, z^-1, ...; b[0] is zero unless x(k) responds to u(k).
        """
        if hold not in ("zoh", "foh"):
            raise ValueError(f"hold must be 'zoh' or 'foh'; got {hold!r}.")
        b, a = _make_pulse(self, float(dt), hold)
        return b.copy(), a.copy()

    def answer(self, u: np.ndarray, dt: float) -> np.ndarray:
        """Simulate x, from rest, with u held between samples.

        Parameters
        ----------
        u : ndarray of shape (n_samples,) or (n_samples, n_runs)
            Input.
        dt : float
            Sampling time in seconds.
        """
        b, a = self.discrete(dt)
        return lfilter(b, a, np.asarray(u, dtype=float), axis=0)

    @property
    def not_invertible(self) -> str | None:
        """Why no input makes x follow a signal; None if one does."""
        if not any(self.numerator):
            return f"the controlled element {self} does not respond to its input"
        for zero in self.zeros:
            if self.dt is None:
                steady = zero.real < -ON_AXIS * max(1.0, abs(zero))
            else:
                # Zeros of sampling are on the negative axis, and count by their gain.
                steady = abs(zero) < 1 - ON_AXIS or (zero.real < 0 and zero.imag == 0)
            if not steady:
                where = "the right half plane" if self.dt is None else "or outside the unit circle"
                return (
                    f"the controlled element {self} has a zero at {zero:.4g}, in {where} or on its "
                    "edge: an input that makes it follow a signal grows without bound"
                )
        return None

    def inverse(self, x: np.ndarray, dt: float) -> np.ndarray:
        """The input that makes x follow a signal: denominator / numerator x.

        The polynomial part uses central differences; the rest is a stable filter, at rest at the
        first value of x. Zeros that come only from sampling, on the negative real axis, are
        replaced by their gain at zero frequency.

        Parameters
        ----------
        x : ndarray of shape (n_samples,) or (n_samples, n_runs)
            Signal to follow.
        dt : float
            Sampling time in seconds.
        """
        reason = self.not_invertible
        if reason is not None:
            raise ValueError(f"There is no inverse: {reason}.")
        signal = np.asarray(x, dtype=float)
        beside = signal if signal.ndim == 2 else signal.reshape(-1, 1)
        found = self._inverse(beside, dt) if self.dt is None else self._inverse_discrete(beside, dt)
        return found.reshape(signal.shape)

    def _inverse(self, x: np.ndarray, dt: float) -> np.ndarray:
        gain = self.numerator[0]
        monic = np.array(self.numerator) / gain
        polynomial, rest = np.polydiv(np.array(self.denominator), monic)
        total: np.ndarray | None = None
        derivative = x
        terms = []
        for c in polynomial[::-1]:
            terms.append((float(c), derivative))
            derivative = np.gradient(derivative, dt, axis=0) if len(x) > 1 else 0.0 * x
        for c, value in reversed(terms):
            if c != 0.0:
                total = c * value if total is None else total + c * value
        assert total is not None
        if rest.any():
            b, a = LinearElement(tuple(rest), tuple(monic)).discrete(dt, "foh")
            start = lfilter_zi(b, a)[:, None] * x[:1]
            total = total + lfilter(b, a, x, axis=0, zi=start)[0]
        return total / gain

    def _inverse_discrete(self, x: np.ndarray, dt: float) -> np.ndarray:
        b, a = self.discrete(dt)
        lead = int(np.flatnonzero(np.abs(b) > TINY * np.abs(b).max())[0])
        kept = b[lead]
        zeros = []
        for zero in np.roots(b[lead:]):
            if zero.imag == 0 and zero.real < 0:
                kept = kept * (1 - zero.real)
            else:
                zeros.append(zero)
        below = np.real(kept * np.poly(zeros)) if zeros else np.array([kept])
        # u follows x some samples later: look ahead, with the last value held.
        ahead = np.concatenate([x[lead:], np.repeat(x[-1:], min(lead, len(x)), axis=0)])[: len(x)]
        before = np.repeat(x[:1], a.size - 1, axis=0)
        past = np.concatenate([before, ahead])
        moved = sum(c * past[a.size - 1 - i : len(past) - i] for i, c in enumerate(a))
        if below.size == 1:
            return moved / below[0]
        start = lfilter_zi([1.0], below)[:, None] * moved[:1]
        return lfilter([1.0], below, moved, axis=0, zi=start)[0]


def _read_text(text: str, dt: float | None) -> LinearElement:
    """An element from a ratio of polynomials in s, or in z with its sampling time (s)."""
    top, bottom, variable = parse(text)
    if (variable == "z") != (dt is not None) and variable:
        what = "give its sampling time too, dt=... in s" if variable == "z" else "leave dt out"
        raise ValueError(f"The controlled element {text!r} is in {variable}: {what}.")
    return LinearElement(tuple(top), tuple(bottom), dt)


def _check_coefficients(values: Any) -> np.ndarray:
    if not isinstance(values, (Sequence, np.ndarray)) and not np.isscalar(values):
        values = list(values)
    given = np.atleast_1d(np.asarray(values, dtype=float))
    if given.ndim != 1 or not given.size or not np.isfinite(given).all():
        raise ValueError(
            f"LinearElement: coefficients must be a sequence of finite numbers; got {values!r}."
        )
    leading = np.flatnonzero(given)
    return given[leading[0] :] if leading.size else given[-1:]


@lru_cache(maxsize=64)
def _make_pulse(element: LinearElement, dt: float, hold: str) -> tuple[np.ndarray, np.ndarray]:
    if element.dt is not None and abs(dt / element.dt - 1) < SAME_CLOCK:
        a = np.array(element.denominator)
        return np.r_[np.zeros(a.size - len(element.numerator)), element.numerator], a
    if element.order == 0:
        return np.array([element.numerator[0]]), np.ones(1)
    # SciPy takes coefficients below 1e-14 as zero: units must not decide that.
    unit = 2.0 ** np.frexp(np.abs(element.numerator).max())[1]
    A, B, C, D = tf2ss(np.array(element.numerator) / unit, element.denominator)
    C, D = unit * C, unit * D
    n = len(A)
    if element.dt is None:
        poles = np.exp(dt * element.poles)
    else:
        if np.any((element.poles.real <= 0) & (np.abs(element.poles.imag) < TINY)):
            raise ValueError(
                f"The controlled element {element} cannot be converted to {dt:g} s: it has a pole "
                f"on the negative real axis, or a pure delay, which no continuous element has. "
                f"Give it at dt={dt:g}, or resample the recording (resample_runs)."
            )
        held = np.block([[A, B], [np.zeros((1, n)), np.ones((1, 1))]])
        generator = np.real(logm(held)) / element.dt
        A, B = generator[:n, :n], generator[:n, n:]
        poles = element.poles.astype(complex) ** (dt / element.dt)
    a = np.real(np.poly(poles))
    # From the first samples of the response to one sample of input b follows exactly.
    A, B, C, D, _ = cont2discrete((A, B, C, D), dt, hold)
    h = [float(D[0, 0])]
    for _ in range(n):
        h.append(float((C @ B)[0, 0]))
        B = A @ B
    b = np.convolve(a, h)[: n + 1]
    if element.direct:
        b = np.r_[b[1:], 0.0]
    return b, a
