"""A study's folder: finished blocks as Parquet files, and the study they belong to."""

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
from ...io import is_left_over, require, written_whole
from .identity import differing_parts, digest

MANIFEST = "study.json"
BLOCKS = "blocks"
NAME = re.compile(r"block-(\d{6,})\.parquet")
KEY = b"skhoid"  # of the file's metadata
NUMBERS = (bool, int, float, np.bool_, np.number)


class Store:
    """The folder of one study.

    A block is written under a temporary name and then moved into place, so a file with its name is
    complete. Files that are nevertheless damaged, or belong to other blocks, are recognised by the
    digest of the study, their number and the checksums of their pages and table, and are computed
    again.
    """

    def __init__(self, folder: str | os.PathLike[str], description: dict[str, Any]) -> None:
        self.folder, self.description = Path(folder), description
        self.digest = digest(description)
        self.pyarrow = require("pyarrow", "A study with a folder")
        self.parquet = require("pyarrow.parquet", "A study with a folder")
        self._open()

    def _open(self) -> None:
        _check_folder(self.folder)
        manifest = self.folder / MANIFEST
        if os.path.lexists(manifest):
            there = read_manifest(self.folder) or {}
            if there != self.description:
                apart = differing_parts(there, self.description)
                more = f" (and {len(apart) - 4} more)" if len(apart) > 4 else ""
                raise StudyFolderError(
                    f"The folder {self.folder} belongs to a different study: "
                    f"{'; '.join(apart[:4])}{more}. Use another folder, or delete this one."
                )
        else:
            strangers = sorted(self.folder.iterdir()) if self.folder.exists() else []
            strangers = [path for path in strangers if not is_left_over(path)]
            if strangers:
                raise StudyFolderError(
                    f"The folder {self.folder} does not belong to a study: it has no {MANIFEST}, "
                    f"but holds {strangers[0].name}. Use an empty or a new folder."
                )
            self.folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps(self.description, indent=1)
            with written_whole(manifest) as path:
                path.write_text(text, encoding="utf-8")
        blocks = self.folder / BLOCKS
        _check_folder(blocks)
        blocks.mkdir(exist_ok=True)

    def finished(self) -> dict[int, pd.DataFrame]:
        """Blocks that are complete, by number; others are deleted."""
        found: dict[int, pd.DataFrame] = {}
        for path in sorted((self.folder / BLOCKS).iterdir()):
            match = NAME.fullmatch(path.name)
            if match is None:
                if is_left_over(path):  # of a process that was killed while it wrote
                    path.unlink(missing_ok=True)
                continue
            number = int(match[1])
            if not path.is_file():
                what = "a folder" if path.is_dir() else "not a file, or a broken link"
                raise StudyFolderError(
                    f"{path} is {what}, where a block of the study should be. Delete it, and the "
                    "block will be computed again."
                )
            try:
                found[number] = self._read(path, number)
            except PermissionError as error:
                raise StudyFolderError(
                    f"{path} is a block of the study, but you have no permission to read it. "
                    "Change its permissions, or delete it, and it will be computed again."
                ) from error
            except Exception as error:
                reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
                warnings.warn(
                    f"{path} is damaged ({reason}); the block is computed again.",
                    StudyWarning,
                    stacklevel=4,
                )
                path.unlink()
        return found

    def _read(self, path: Path, number: int) -> pd.DataFrame:
        table = self.parquet.read_table(path, page_checksum_verification=True, partitioning=None)
        stamp = (table.schema.metadata or {}).get(KEY, b"").decode()
        found = uniform(table.replace_schema_metadata().to_pandas())
        if not stamp.startswith(f"{self.digest} {number} "):
            raise ValueError("not the block of this study that its name promises")
        if stamp != self._stamp(number, found):
            raise ValueError("not what was written")
        return found

    def _stamp(self, number: int, table: pd.DataFrame) -> str:
        return f"{self.digest} {number} {checksum(table)}"

    def write(self, number: int, table: pd.DataFrame) -> None:
        """Write one block, completely or not at all."""
        arrow = self.pyarrow.Table.from_pandas(table, preserve_index=False)
        arrow = arrow.replace_schema_metadata({KEY: self._stamp(number, table)})
        with written_whole(self.folder / BLOCKS / f"block-{number:06d}.parquet") as path:
            self.parquet.write_table(arrow, path, write_page_checksum=True)


def _check_folder(path: Path) -> None:
    """Refuse anything but a readable folder."""
    if not os.path.lexists(path):
        return
    if not path.is_dir():
        what = "a broken link" if path.is_symlink() else "a file"
        raise StudyFolderError(f"{path} is {what}; a study needs a folder there.")
    if not os.access(path, os.R_OK | os.W_OK | os.X_OK):
        raise StudyFolderError(f"The folder {path} cannot be read and written to.")


def read_manifest(folder: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The description of the study to which a folder belongs; None if it has none."""
    manifest = Path(folder) / MANIFEST
    if not os.path.lexists(manifest):
        return None
    try:
        found = json.loads(manifest.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise StudyFolderError(
            f"{manifest} cannot be read ({error}): the study to which the folder belongs is "
            "unknown. "
            "Use another folder, or delete this one."
        ) from error
    if not isinstance(found, dict) or not str(found.get("entropy", "")).isdecimal():
        raise StudyFolderError(f"{manifest} is not a description of a study. Use another folder.")
    return found


def uniform(table: pd.DataFrame) -> pd.DataFrame:
    """The same columns whether a table comes from memory or from a file.

    Whole numbers and truth values stay so unless one is missing, which makes them floating-point;
    what is not a number becomes text, and missing text is None.
    """
    columns = {name: _uniform(column) for name, column in table.items()}
    return pd.DataFrame(columns, index=range(len(table)))


def _uniform(column: pd.Series) -> pd.Series:
    kind = getattr(column.dtype, "kind", "O") if isinstance(column.dtype, np.dtype) else "O"
    if kind in "bif":
        return pd.Series(column.to_numpy(dtype={"b": bool, "i": np.int64, "f": np.float64}[kind]))
    missing, values = column.isna().to_numpy(), column.to_numpy(dtype=object)
    kinds = {type(value) for value in values[~missing]}
    if not kinds:
        is_number = pd.api.types.is_numeric_dtype(column.dtype)
        return pd.Series(np.full(missing.size, np.nan if is_number else None))
    if all(issubclass(kind, NUMBERS) for kind in kinds):
        if all(issubclass(kind, (bool, np.bool_)) for kind in kinds) and not missing.any():
            return pd.Series(column.to_numpy(dtype=bool))
        whole = all(issubclass(kind, (int, np.integer)) and kind is not bool for kind in kinds)
        if whole and not missing.any() and abs(max(values, key=abs)) < 2**63:
            return pd.Series(values.astype(np.int64))
        return pd.Series(column.to_numpy(dtype=float, na_value=np.nan))
    if not all(issubclass(kind, str) for kind in kinds):
        texts = [value if isinstance(value, str) else str(value) for value in values]
        values = np.array(texts, dtype=object)
    return pd.Series(np.where(missing, None, values), dtype=object)


def checksum(table: pd.DataFrame) -> str:
    """Checksum of the names, types and values of a table as :func:`uniform` makes it."""
    found = hashlib.sha256()
    for name, column in table.items():
        found.update(f"{name} {column.dtype} {len(column)} ".encode())
        text = column.dtype == object
        found.update(json.dumps(list(column)).encode() if text else column.to_numpy().tobytes())
    return found.hexdigest()[:16]
