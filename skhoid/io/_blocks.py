"""Columns of large files, put together block by block, so that memory holds nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

__all__ = ["Block", "gathered"]

# Columns of some rows, the codes of their labels (-1: missing), and what these stand for.
Block = tuple[list[np.ndarray], np.ndarray | None, list[Any]]


def gathered(blocks: Iterator[Block], n_columns: int, most: int, labelled: bool) -> Block:
    """Float64 columns of at most ``most`` rows in all, and their labels by number."""
    columns = [np.empty(most) for _ in range(n_columns)]
    codes = np.empty(most, dtype=np.int32) if labelled else None
    known: dict[Any, int] = {}
    stop = 0
    for parts, own, labels in blocks:
        start, stop = stop, stop + len(parts[0] if own is None else own)
        for column, part in zip(columns, parts, strict=True):
            column[start:stop] = part
        if codes is not None:
            places = [known.setdefault(label, len(known)) for label in labels]
            codes[start:stop] = np.array([*places, -1], dtype=np.int32)[own]
    columns = [column[:stop] for column in columns]
    return columns, None if codes is None else codes[:stop], list(known)
