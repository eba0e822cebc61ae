"""The existing files that a user names by paths, patterns or lists of these."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

__all__ = ["Paths", "expand_paths", "shown"]

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


def expand_paths(paths: Paths) -> list[Path]:
    """List the files; lists keep their order, the matches of a pattern are in natural order."""
    items = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    if not items:
        raise ValueError("paths is empty: name at least one file or glob pattern.")
    return [path for item in items for path in _expand(item)]


def shown(name: str | os.PathLike[str]) -> str:
    r"""A file name that can be printed: bytes that are not UTF-8 become ``\xff``."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _expand(item: Any) -> list[Path]:
    if not isinstance(item, str | os.PathLike):
        raise TypeError(
            f"paths must be a path, a glob pattern or a list of these; it holds {item!r} "
            f"({type(item).__name__})."
        )
    path = Path(item).expanduser()
    if path.is_dir():
        raise ValueError(
            f"{path} is a folder: name its files with a pattern, such as "
            f"{os.fspath(path / '*.csv')!r}."
        )
    # A file whose name has brackets is taken as a file before it is taken as a pattern.
    if path.is_file():
        return [path]
    pattern = os.fspath(path)
    if glob.has_magic(pattern):
        found = [Path(name) for name in glob.glob(pattern, recursive=True)]
        files = sorted((match for match in found if match.is_file()), key=_natural)
        if not files:
            raise FileNotFoundError(
                f"No file matches the pattern {pattern!r} (working folder: {Path.cwd()})."
            )
        return files
    if path.exists():
        raise ValueError(f"{path} is not a regular file and cannot be read.")
    raise FileNotFoundError(f"There is no file {path} (working folder: {Path.cwd()}).")


def _natural(path: Path) -> list[Any]:
    """Sort run2 before run10."""
    parts = re.split(r"(\d+)", os.fspath(path))
    # re.split alternates text and digits, so equal positions always hold equal types.
    return [int(part) if part.isdecimal() else part for part in parts]
