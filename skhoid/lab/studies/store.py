"""A study's folder: finished blocks as tables in JSON, and the study they belong to."""

from __future__ import annotations

import hashlib
import json
import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ... import StudyFolderError, StudyWarning
from ...io import is_left_over, written_whole
from .identity import differing_parts, digest

MANIFEST, BLOCKS = "study.json", "blocks"
NAME = re.compile(r"block-(\d{6,})-([0-9a-f]{16})\.json")
NUMBERS = (bool, int, float, np.bool_, np.number)


class Store:
    """The folder of one study.

    A block is written under a temporary name and then moved into place, so a file with its name is
    complete. The name holds a checksum of the study, the number and the contents: what is damaged,
    or belongs to other blocks, is computed again.
    """

    def __init__(self, folder: str | os.PathLike[str], description: dict[str, Any]) -> None:
        self.folder, self.digest = Path(folder), digest(description)
        there = read_manifest(folder)
        if there is None:
            if self.folder.exists() and not self.folder.is_dir():
                raise StudyFolderError(f"{folder} is a file; a study needs a folder there.")
            strangers = sorted(self.folder.iterdir()) if self.folder.exists() else []
            strangers = [path for path in strangers if not is_left_over(path)]
            if strangers:
                raise StudyFolderError(
                    f"The folder {folder} does not belong to a study: it has no {MANIFEST}, "
                    f"but holds {strangers[0].name}. Use an empty or a new folder."
                )
            self.folder.mkdir(parents=True, exist_ok=True)
            with written_whole(self.folder / MANIFEST) as path:
                path.write_text(json.dumps(description, indent=1), encoding="utf-8")
        elif there != description:
            apart = differing_parts(there, description)
            more = f" (and {len(apart) - 4} more)" if len(apart) > 4 else ""
            raise StudyFolderError(
                f"The folder {folder} belongs to a different study: {'; '.join(apart[:4])}{more}. "
                "Use another folder, or delete this one."
            )
        (self.folder / BLOCKS).mkdir(exist_ok=True)

    def finished(self) -> dict[int, pd.DataFrame]:
        """Blocks that are complete, by number; others are deleted."""
        found: dict[int, pd.DataFrame] = {}
        for path in sorted((self.folder / BLOCKS).iterdir()):
            match = NAME.fullmatch(path.name)
            if match is None:
                if is_left_over(path):  # of a process that was killed while it wrote
                    path.unlink(missing_ok=True)
                continue
            number, contents = int(match[1]), path.read_bytes()
            if self._checksum(number, contents) == match[2]:
                columns = json.loads(contents)
                found[number] = pd.DataFrame(
                    {
                        name: pd.Series(values, dtype=kind)
                        for name, (kind, values) in columns.items()
                    }
                )
                continue
            warnings.warn(
                f"{path} is damaged, or not the block of this study that its name promises; the "
                "block is computed again.",
                StudyWarning,
                stacklevel=3,
            )
            path.unlink()
        return found

    def _checksum(self, number: int, contents: bytes) -> str:
        return hashlib.sha256(f"{self.digest} {number} ".encode() + contents).hexdigest()[:16]

    def write(self, number: int, table: pd.DataFrame) -> None:
        """Write one block, completely or not at all."""
        columns = {name: (str(each.dtype), each.tolist()) for name, each in table.items()}
        contents = json.dumps(columns).encode()  # floats to the last digit
        name = f"block-{number:06d}-{self._checksum(number, contents)}.json"
        with written_whole(self.folder / BLOCKS / name) as path:
            path.write_bytes(contents)


def read_manifest(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The description of the study to which a folder belongs; None if it has none."""
    manifest = Path(folder) / MANIFEST
    if not manifest.exists():
        return None
    try:
        return dict(json.loads(manifest.read_text(encoding="utf-8")))
    except (ValueError, TypeError) as error:
        raise StudyFolderError(
            f"{manifest} cannot be read ({error}): the study to which the folder belongs is "
            "unknown. Use another folder, or delete this one."
        ) from error


def uniform(table: pd.DataFrame) -> pd.DataFrame:
    """The same columns whether a table comes from memory or from a file.

    Whole numbers and truth values stay so unless one is missing, which makes them floating-point;
    what is not a number becomes text, and missing text is None.
    """
    columns = {name: _uniform(column) for name, column in table.items()}
    return pd.DataFrame(columns, index=range(len(table)))


def _uniform(column: pd.Series) -> pd.Series:
    kind = column.dtype.kind if isinstance(column.dtype, np.dtype) else "O"
    if kind in "bif":
        return pd.Series(column.to_numpy(dtype={"b": bool, "i": np.int64, "f": np.float64}[kind]))
    missing, values = column.isna().to_numpy(), column.to_numpy(dtype=object)
    known = values[~missing]
    if not known.size:
        is_number = pd.api.types.is_numeric_dtype(column.dtype)
        return pd.Series(np.full(missing.size, np.nan if is_number else None))
    if all(isinstance(value, NUMBERS) for value in known):
        if not missing.any():
            whole = np.array(list(known))
            if (
                whole.dtype.kind in "bi"
                and len({isinstance(v, (bool, np.bool_)) for v in known}) < 2
            ):
                return pd.Series(whole)
        return pd.Series(column.to_numpy(dtype=float, na_value=np.nan))
    texts = [None if gone else str(value) for value, gone in zip(values, missing, strict=True)]
    return pd.Series(texts, dtype=object)
