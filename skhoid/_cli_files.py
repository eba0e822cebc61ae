"""What commands of the command line share: options of files, reading them, JSON."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable
from typing import Any


def at_least_one(text: str) -> int:
    """A whole number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number, at least 1; got {text!r}")
    return int(text)


def add_file_options(add: Callable[..., Any]) -> None:
    """Options that say which files, and what is in them."""
    add("files", nargs="*", metavar="FILES", help="CSV, Parquet or MAT files, or patterns")
    add("--output", default="u", metavar="NAME", help="output channel (default: u)")
    add("--time", metavar="NAME", help="time channel, in seconds")
    add("--run", metavar="NAME", help="column with run labels (default: one file is one run)")
    add("--dt", type=float, metavar="S", help="sampling time, for files without a time channel")
    add(
        "--unit",
        action="append",
        default=[],
        metavar="NAME=UNIT",
        help="unit of a channel; 'ms' for time converts it; may be repeated",
    )
    add(
        "--resample",
        action="store_true",
        help="bring an irregular clock onto a regular grid by interpolation first",
    )


def pairs(items: Iterable[str], option: str, example: str) -> dict[str, str]:
    """NAME=VALUE words of an option that may be repeated."""
    found = {}
    for item in items:
        name, sign, value = item.partition("=")
        if not sign:
            raise ValueError(f"{option} takes {example}; got {item!r}.")
        found[name] = value
    return found


def read_files(options: argparse.Namespace, inputs: list[str]) -> tuple[Any, Any]:
    """X and y of the files that the options name."""
    from . import read_runs, resample_runs

    if options.time is None and options.dt is None:
        raise ValueError("Say where time comes from: --time NAME, or --dt SECONDS.")
    units = pairs(options.unit, "--unit", "NAME=UNIT, such as e=deg")
    X, y = read_runs(
        options.files,
        inputs=inputs,
        output=options.output,
        time=options.time,
        run=options.run,
        units=units or None,
        dt=options.dt,
    )
    return resample_runs(X, y, dt=options.dt) if options.resample else (X, y)


def as_json(found: dict[str, Any]) -> str:
    """JSON text; it has no NaN, so null stands for it."""
    return json.dumps(_finite(found), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def without_screen() -> None:
    """Draw into files, on machines without a display too."""
    import matplotlib

    matplotlib.use("Agg")
