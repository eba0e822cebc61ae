"""Values of options: numbers and NAME=VALUE pairs, and refusal of options without effect."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterable
from typing import Any

MOST = 1_000_000  # of what is counted: runs, replications, subjects
MOST_ORDERS = 100
MOST_SAMPLES = 100_000  # of a delay
MOST_WORKERS = 8 * (os.cpu_count() or 1)


def at_least_one(text: str) -> int:
    """A whole number from 1 up."""
    return _whole(text, 1, MOST)


def order(text: str) -> int:
    """An order of an ARX model."""
    return _whole(text, 1, MOST_ORDERS)


def samples(text: str) -> int:
    """A delay in samples."""
    return _whole(text, 0, MOST_SAMPLES)


def count(text: str) -> int:
    """A whole number from 0 up."""
    return _whole(text, 0, MOST)


def seed(text: str) -> int:
    """A whole number from 0 up, however large."""
    return _whole(text, 0, None)


def workers(text: str) -> int:
    """A number of workers, or -1 for all processors, -2 for all but one, as joblib counts."""
    if text.startswith("-"):
        return -_whole(text[1:], 1, MOST_WORKERS)
    return _whole(text, 1, MOST_WORKERS)


def _whole(text: str, least: int, most: int | None) -> int:
    # int() takes no more than 4,300 digits.
    if not (text.isascii() and text.isdecimal() and len(text) < 100) or int(text) < least:
        raise argparse.ArgumentTypeError(
            f"must be a whole number, at least {least}; got {text[:40]!r}"
        )
    if most is not None and int(text) > most:
        raise argparse.ArgumentTypeError(f"must be at most {most}; got {text!r}")
    return int(text)


def probability(text: str) -> float:
    """A number above 0 and below 1."""
    number = _finite(text)
    if not 0 < number < 1:
        raise argparse.ArgumentTypeError(f"must be a number above 0 and below 1; got {text!r}")
    return number


def positive(text: str) -> float:
    """A number above 0."""
    number = _finite(text)
    if not number > 0:
        raise argparse.ArgumentTypeError(f"must be a number above 0; got {text!r}")
    return number


def not_negative(text: str) -> float:
    """A number from 0 up."""
    number = _finite(text)
    if not number >= 0:
        raise argparse.ArgumentTypeError(f"must be a number, at least 0; got {text!r}")
    return number


def _finite(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan


def with_one_element(words: list[str]) -> list[str]:
    """Arguments in which the two numbers of a controlled element are one word.

    Two numbers and one text cannot both be an option's values, as file names may follow it.
    """
    option = "--controlled-element"
    for i, word in enumerate(words):
        numbers = words[i + 1 : i + 3]
        if (
            word == option
            and len(numbers) == 2
            and not any(math.isnan(_finite(n)) for n in numbers)
        ):
            return [*words[: i + 1], " ".join(numbers), *words[i + 3 :]]
    return words


def pairs(items: Iterable[str], option: str, example: str) -> dict[str, str]:
    """NAME=VALUE pairs of an option that may be repeated."""
    found: dict[str, str] = {}
    for item in items:
        name, sign, value = item.partition("=")
        if not sign:
            raise ValueError(f"{option} takes {example}; got {item!r}.")
        if name in found:
            raise ValueError(
                f"{option} says twice what {name!r} is, {found[name]!r} and {value!r}: say it once."
            )
        found[name] = value
    return found


def is_given(options: argparse.Namespace, name: str) -> bool:
    """Whether an option was given; 0 is a value."""
    value: Any = getattr(options, name, None)
    return not (value is None or value is False or value == [])


def refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Refuse options that would have no effect; ``why`` completes the sentence after their name."""
    for name in names:
        if is_given(options, name):
            raise ValueError(f"--{name.replace('_', '-')} {why}")
