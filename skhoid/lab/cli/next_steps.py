"""What to do next: commands that work as they are typed, on the same files."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...search.shape import BY_HAND

Steps = list[tuple[str, str]]
# Options that say what is in the files, which the next command needs too.
OF_FILES = ("output", "time", "run", "subject", "condition", "dt", "run_in", "x", "target")


def _typed(options: argparse.Namespace, *commands: str, without: Sequence[str] = ()) -> str:
    """A command about the same files, with what was said of them."""
    words = ["skhoid", *commands, *map(str, options.files)]
    for name in OF_FILES:
        value = getattr(options, name, None)
        if value is not None and name not in without:
            typed = f"{value:.12g}" if isinstance(value, float) else str(value)
            words += [f"--{name.replace('_', '-')}", typed]
    for name in ("unit", "role"):
        for value in getattr(options, name, None) or []:
            words += [f"--{name}", value]
    if getattr(options, "resample", False):
        words.append("--resample")
    inputs = getattr(options, "named_input", None)
    if inputs:
        words += ["--input", *inputs]
    return shlex.join(words)


def after_diagnose(options: argparse.Namespace, search: Any) -> Steps:
    """After a search: its report, its tables, and the linear model."""
    steps = []
    page = _free("report.html")
    if not getattr(options, "report", None) and options.command != "report":
        steps.append((f"{_typed(options, 'report')} --out {page}", "the same as a page to keep"))
    if search.best_effects_ and search.best_effects_ != ["unknown"]:
        names = [name for name in search.best_effects_ if name != "unknown"]
        steps.append(
            (
                f"{_typed(options, 'diagnose')} --effects {' '.join(dict.fromkeys(names))}",
                "these effects alone, in less time",
            )
        )
    steps.append((_typed(options, "identify"), "the delay, and a linear model"))
    if search.shape_ is not None and options.command != "diagnose":
        steps.append((BY_HAND, "in Python: what has no name as an effect of your own"))
    elif search.shape_ is not None and options.sketch is None:
        words = ["skhoid", *options.command_line, "--sketch", _free("my_effect.py")]
        steps.append((shlex.join(words), "what has no name as an effect of your own, in Python"))
    return steps


def after_identify(options: argparse.Namespace, notes: Sequence[str]) -> Steps:
    """After a linear model: what it is missing, and a more robust fit."""
    first = _typed(options, "diagnose")
    if len(getattr(options, "named_input", None) or []) > 1:
        options = argparse.Namespace(**{**vars(options), "named_input": None})
        first = _typed(options, "diagnose")
    return [(first, "which effects is the model missing?")]


def after_compare(options: argparse.Namespace) -> Steps:
    """After a comparison: its picture, and what is missing."""
    steps = []
    if options.out is None:
        words = [*options.command_line, "--out", _free("compared.png")]
        steps.append((shlex.join(["skhoid", *words]), "the same as a picture"))
    steps.append((_typed(options, "diagnose"), "which effects are missing?"))
    return steps


def _free(name: str) -> str:
    """A file name that is not taken yet."""
    stem, ending = os.path.splitext(name)
    number, free = 2, name
    while Path(free).exists():
        free, number = f"{stem}-{number}{ending}", number + 1
    return free
