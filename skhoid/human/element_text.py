"""Transfer functions written as text: ``"90/(s^2 + 6s)"`` to polynomials and back."""

from __future__ import annotations

import re
from typing import NoReturn

import numpy as np

EXAMPLES = '"1/s", "1/(s(s+1))", "90/(s^2+6s)", "2(s+3)/(s^2 (s+0.5))"'
LARGEST_POWER = 20
TOKEN = re.compile(r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|(\*\*|.))")
Ratio = tuple[np.ndarray, np.ndarray]  # coefficients of numerator and denominator


def is_number(text: str) -> bool:
    """Whether a text is just a number, which counts as a gain and not as a transfer function."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def parsed(text: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Numerator, denominator (highest power first) and variable ("s", "z" or "") of a text."""
    return _Parser(text).result()


def written(numerator: tuple[float, ...], denominator: tuple[float, ...], variable: str) -> str:
    """A transfer function as text, its denominator with poles at zero in front."""
    n_zero = 0
    while n_zero < len(denominator) - 1 and denominator[-1 - n_zero] == 0.0:
        n_zero += 1
    rest = denominator[: len(denominator) - n_zero]
    power = "" if n_zero == 0 else variable if n_zero == 1 else f"{variable}^{n_zero}"
    above = _polynomial(numerator, variable)
    below = power
    if len(rest) > 1:
        below = f"({_polynomial(rest, variable)})"
        below = f"({power} {below})" if power else below
    several = sum(c != 0.0 for c in numerator) > 1
    if not below:
        return above
    return f"({above})/{below}" if several else f"{above}/{below}"


def _polynomial(coefficients: tuple[float, ...], variable: str) -> str:
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


class _Parser:
    """Recursive descent over sums, products and powers, on ratios of polynomials."""

    def __init__(self, text: str):
        self.text = text
        self.tokens: list[str] = []
        self.variable = ""
        position, end = 0, len(text.rstrip())
        while position < end:
            found = TOKEN.match(text, position)
            assert found is not None
            position = found.end()
            self.tokens.append(found[1] or found[2])
        self.at = 0

    def result(self) -> tuple[np.ndarray, np.ndarray, str]:
        if not self.tokens:
            self.fail("it is empty")
        numerator, denominator = self.sum()
        if self.at < len(self.tokens):
            self.fail(f"there is one {self.tokens[self.at]!r} too many")
        while min(numerator.size, denominator.size) > 1 and numerator[-1] == denominator[-1] == 0:
            numerator, denominator = numerator[:-1], denominator[:-1]
        return numerator, denominator, self.variable

    def fail(self, what: str) -> NoReturn:
        raise ValueError(
            f"The controlled element {self.text!r} cannot be read: {what}. Write a ratio of "
            f"polynomials in s, or in z with dt, such as {EXAMPLES}."
        )

    @property
    def next(self) -> str:
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def taken(self) -> str:
        token = self.next
        self.at += 1
        return token

    def sum(self) -> Ratio:
        sign = self.taken() if self.next in ("+", "-") else "+"
        total = self.product()
        if sign == "-":
            total = -total[0], total[1]
        while self.next in ("+", "-"):
            by = 1.0 if self.taken() == "+" else -1.0
            n, d = self.product()
            if np.array_equal(total[1], d):
                total = np.polyadd(total[0], by * n), d
                continue
            top = np.polyadd(np.polymul(total[0], d), by * np.polymul(n, total[1]))
            total = top, np.polymul(total[1], d)
        return total

    def product(self) -> Ratio:
        top, bottom = self.power()
        divided = False
        while True:
            if self.next in ("*", "/"):
                divided = self.taken() == "/"
                n, d = self.power()
            elif self.next and self.next not in ("+", "-", ")"):
                if divided:
                    self.fail(
                        f"it is not clear whether {self.next!r} belongs to the denominator "
                        'before it: write "1/(s(s+1))" or "(1/s)(s+1)"'
                    )
                n, d = self.power()
            else:
                return top, bottom
            if divided:
                if not np.any(n):
                    self.fail("it divides by zero")
                n, d = d, n
            top, bottom = np.polymul(top, n), np.polymul(bottom, d)

    def power(self) -> Ratio:
        base = self.atom()
        if self.next not in ("^", "**"):
            return base
        self.at += 1
        exponent = self.taken()
        if not exponent.isdigit() or int(exponent) > LARGEST_POWER:
            self.fail(f"a power must be a whole number up to {LARGEST_POWER}; got {exponent!r}")
        top: np.ndarray = np.ones(1)
        bottom: np.ndarray = np.ones(1)
        for _ in range(int(exponent)):
            top, bottom = np.polymul(top, base[0]), np.polymul(bottom, base[1])
        return top, bottom

    def atom(self) -> Ratio:
        token = self.taken()
        if token == "(":
            inside = self.sum()
            if self.taken() != ")":
                self.fail('a closing bracket ")" is missing')
            return inside
        if token in ("s", "z"):
            if self.variable not in ("", token):
                self.fail("it has both s and z")
            self.variable = token
            return np.array([1.0, 0.0]), np.ones(1)
        if token and (token[0].isdigit() or token[0] == "."):
            return np.array([float(token)]), np.ones(1)
        if not token:
            self.fail("it ends too early")
        if token.isalpha():
            self.fail(f"{token!r} is unknown: use only s (or z) and numbers, no names of gains")
        self.fail(f"{token!r} was not expected there")
