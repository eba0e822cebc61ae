"""Plain numbers from large CSV files, block by block, with the fastest exact reader."""

from __future__ import annotations

import csv
import importlib
import io
import warnings
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ._blocks import Block, gathered

if TYPE_CHECKING:
    from ._sheet import Sheet

__all__ = ["EXACT", "plain_columns"]

# The default parser of pandas < 3.1 is off by an ulp for some numbers; later it is exact, and the
# option deprecated.
EXACT: dict[str, Any] = (
    {"float_precision": "round_trip"}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    else {}
)
_BYTES, _ROWS = 1 << 22, 1 << 17  # of a block
# What pandas takes for missing.
_MISSING = ["", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND"]
_MISSING += ["1.#QNAN", "<NA>", "N/A", "NA", "NULL", "NaN", "None", "n/a", "nan", "null"]


def plain_columns(
    sheet: Sheet, numbers: Sequence[int], labels: int | None
) -> tuple[list[np.ndarray], tuple[np.ndarray, list[Any]] | None] | None:
    """Columns as float64 arrays, and one as codes and labels; None if a cell is not a plain number.

    What is not plain (text, truth values, a mixture of decimal commas and points) is left to
    pandas' own inference, which looks at all cells at once.
    """
    if sheet.decimal is None:
        return None
    wanted = list(dict.fromkeys(numbers))
    for blocks in (_by_arrow, _by_pandas):
        try:
            columns, codes, texts = gathered(
                blocks(sheet, wanted, labels), len(wanted), sheet.text.n_lines, labels is not None
            )
            found = dict(zip(wanted, columns, strict=True))
            label = None if codes is None else (codes, _inferred(texts, sheet.decimal))
            return [found[position] for position in numbers], label
        # Errors of PyArrow and pandas are ValueErrors.
        except (ValueError, pd.errors.ParserWarning, ImportError):
            continue
    return None


def _by_arrow(sheet: Sheet, wanted: list[int], labels: int | None) -> Iterator[Block]:
    """Of files without quotes; PyArrow refuses most of what pandas reads in another way."""
    pyarrow = importlib.import_module("pyarrow")
    reader = importlib.import_module("pyarrow.csv")
    if sheet.text.encoding != "utf-8-sig" or sheet.has_quotes or labels in wanted:
        raise ValueError
    types = {str(position): pyarrow.float64() for position in wanted}
    if labels is not None:
        types[str(labels)] = pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
    names = [str(position) for position in range(len(sheet.names))]
    # PyArrow opens no files whose names are not UTF-8.
    with (
        sheet.text.path.open("rb") as file,
        reader.open_csv(
            file,
            reader.ReadOptions(column_names=names, skip_rows=sheet.skip, block_size=_BYTES),
            reader.ParseOptions(delimiter=sheet.separator, quote_char=False),
            reader.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=_MISSING,
                decimal_point=sheet.decimal,
            ),
        ) as batches,
    ):
        for batch in batches:
            parts = [part.to_numpy(zero_copy_only=False) for part in batch.columns[: len(wanted)]]
            for part, column in zip(parts, batch.columns, strict=False):
                if np.isnan(part).sum() != column.null_count:
                    raise ValueError  # "Nan" and "nan(1)", which are text for pandas
            if labels is None:
                yield parts, None, []
                continue
            label = batch.columns[-1]
            texts = [text.lstrip() for text in label.dictionary.to_pylist()]
            yield parts, label.indices.to_numpy(), texts


def _by_pandas(sheet: Sheet, wanted: list[int], labels: int | None) -> Iterator[Block]:
    if labels in wanted:
        raise ValueError
    types: dict[int, Any] = dict.fromkeys(wanted, np.float64)
    if labels is not None:
        types[labels] = str
    with sheet.text.open(sheet.skip) as file, warnings.catch_warnings():
        # Rows with more cells than the header; in Sheet.parse they become an error.
        warnings.simplefilter("error", pd.errors.ParserWarning)
        options = {"dtype": types, "decimal": sheet.decimal, "low_memory": False}
        for block in sheet.read(file, chunksize=_ROWS, **options):
            parts = [block[position].to_numpy() for position in wanted]
            if labels is None:
                yield parts, None, []
                continue
            own, texts = pd.factorize(block[labels])
            yield parts, own, list(texts)


def _inferred(texts: list[str], decimal: str) -> list[Any]:
    """Numbers or texts, as pandas reads a column of these cells."""
    if decimal == "," and any("," in text for text in texts):
        raise ValueError
    cells = io.StringIO()
    csv.writer(cells, quoting=csv.QUOTE_ALL).writerows([text] for text in texts)
    cells.seek(0)
    frame = pd.read_csv(cells, header=None, names=[0], skip_blank_lines=False, **EXACT)
    return frame[0].tolist()
