"""What the scripts on real recordings share: where the data lie, a search that speaks, claims."""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from skhoid import EffectSearchCV

DATA = Path(__file__).parents[2] / "shared" / "data"
Table = tuple[pd.DataFrame, pd.Series]
Claims = list[tuple[str, bool]]


def searched(model: Any, X: pd.DataFrame, y: pd.Series, **options: Any) -> EffectSearchCV:
    """Search, and print what it says."""
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = EffectSearchCV(model, **options).fit(X, y)
    print(f"{model}\n{time.perf_counter() - began:.1f} s: {search.best_effects_}")
    print(search.summary(), "\n")
    return search


def options_of(doc: str, names: Iterable[str], metavar: str = "name") -> argparse.Namespace:
    """Names of recordings, all by default, and the folder of data, from the command line."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("names", nargs="*", default=list(names), metavar=metavar)
    parser.add_argument("--data", type=Path, default=DATA)
    return parser.parse_args()


def exit_code(claims: Claims) -> int:
    """Print claims; 1 if one is missed."""
    for text, met in claims:
        print("met   " if met else "MISSED", text)
    return 0 if all(met for _, met in claims) else 1


def judged(
    doc: str, recordings: Mapping[str, Callable[[Path], Claims]], folders: Mapping[str, str]
) -> int:
    """Run the script of each recording; those whose folder is missing are skipped."""
    options = options_of(doc, recordings)
    claims = []
    for name in options.names:
        folder = folders.get(name)
        if folder and not (options.data / folder).is_dir():
            print(f"{name}: skipped, {options.data / folder} is missing\n")
            continue
        print(f"=== {name} ===")
        claims += [(f"{name}: {text}", met) for text, met in recordings[name](options.data)]
    return exit_code(claims)
