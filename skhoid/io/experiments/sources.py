"""The files of an experiment: by a pattern, in a folder, by a glob, or in a list."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._formats import READERS
from .._paths import expand_paths, shown
from .levels import natural
from .patterns import has_fields, match_pattern

__all__ = ["Sources", "find_sources"]

_MOTION = "_motion.tsv"
# Tables beside the recordings in a data set of BIDS, and notes.
_ASIDE = ("participants", "_channels", "_events", "_scans", "_sessions", "samples", "readme")


@dataclass(frozen=True)
class Sources:
    """Files, and the labels that a pattern found in their names; None: names may be guessed.

    ``root`` is the folder below which names mean something. ``listed`` files keep their order.
    """

    files: list[Path]
    root: Path
    labels: list[dict[str, str]] | None = None
    listed: bool = False
    remark: str = ""


def find_sources(paths: Any) -> Sources:
    """The files that a user names."""
    if isinstance(paths, str | os.PathLike):
        text = os.fspath(paths)
        if has_fields(text):
            files, labels = match_pattern(text)
            return Sources(files, Path(), labels)
        folder = Path(text).expanduser()
        if folder.is_dir():
            return _of_folder(folder)
        files = expand_paths(paths)
        return Sources(_different(files), _common(files), listed=not glob.has_magic(text))
    items = list(paths) if isinstance(paths, Iterable) else [paths]
    if any(isinstance(item, str) and has_fields(item) for item in items):
        raise ValueError(
            "A pattern with fields such as {subject} stands alone: give one pattern, or read part "
            "by part and join: pd.concat([X1, X2])."
        )
    files = expand_paths(items)
    return Sources(_different(files), _common(files), listed=True)


def _of_folder(folder: Path) -> Sources:
    found = [
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in READERS
        and path.is_file()
        and not any(part.startswith((".", "_")) for part in path.relative_to(folder).parts)
    ]
    motion = [path for path in found if path.name.endswith(_MOTION)]
    kept = motion or [path for path in found if not _is_aside(path.stem)]
    if not kept:
        raise FileNotFoundError(
            f"The folder {shown(folder)} has no file that can be read ({', '.join(READERS)})."
        )
    kinds = Counter(path.suffix.lower() for path in kept)
    if len(kinds) > 1:
        counts = ", ".join(f"{number} {kind}" for kind, number in kinds.most_common())
        example = os.fspath(folder / "**" / f"*{kinds.most_common(1)[0][0]}")
        raise ValueError(
            f"The folder {shown(folder)} has files of several kinds ({counts}): say which are the "
            f"recordings, as {example!r}, or with a pattern."
        )
    depths = {len(path.relative_to(folder).parts): path for path in kept}
    if len(depths) > 1 and not motion:
        some = [shown(path.relative_to(folder)) for _, path in sorted(depths.items())]
        raise ValueError(
            f"The folder {shown(folder)} has files at several depths, such as "
            f"{' and '.join(map(repr, some[:2]))}: say which are the recordings, with a pattern "
            f"such as {os.fspath(folder / '{subject}' / '{condition}_{run}.csv')!r}."
        )
    aside = len(found) - len(kept)
    remark = f"{aside} other tables in the folder are not read" if aside and not motion else ""
    return Sources(sorted(kept, key=natural), folder, remark=remark)


def _is_aside(stem: str) -> bool:
    stem = stem.casefold()
    return any(stem == name or (name[0] == "_" and stem.endswith(name)) for name in _ASIDE)


def _common(files: list[Path]) -> Path:
    """The folder that the files share."""
    return Path(os.path.commonpath([os.path.abspath(path.parent) for path in files]))


def _different(files: list[Path]) -> list[Path]:
    twice = [path for path, number in Counter(files).items() if number > 1]
    if twice:
        raise ValueError(f"{shown(twice[0])} is named twice in paths.")
    return files
