"""Checksums and a few plain numbers of whatever the package returns.

Open it to change what of a value counts. Prose (text with white space) has a checksum of its own,
so that words can be revised while the numbers are proven to be the same.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd


@dataclass
class Digest:
    """What one walk through a value meets."""

    bits: Any = field(default_factory=hashlib.sha256)
    prose: Any = field(default_factory=hashlib.sha256)
    met_prose: bool = False
    numbers: list[np.ndarray] = field(default_factory=list)

    def plain(self) -> list[str]:
        """First, mean, last and norm of all finite numbers, or the only one."""
        if not self.numbers:
            return []
        flat = np.concatenate(self.numbers)
        flat = flat[np.isfinite(flat)]
        if flat.size < 2:
            return [repr(float(value)) for value in flat]
        # Pairwise sums without BLAS, so that the figures are as reproducible as the data.
        figures = (flat[0], flat.mean(), flat[-1], np.sqrt((flat**2).sum()))
        return [repr(float(figure)) for figure in figures]

    def add(self, value: Any, within: tuple[int, ...] = ()) -> None:
        """Walk through a value; names of classes and what is private have no part in it."""
        if value is None or isinstance(value, (bool, np.bool_, int, float, complex, np.number)):
            self._scalar(value)
        elif isinstance(value, str):
            self._text(value)
        elif isinstance(value, np.ndarray):
            self._array(value, within)
        elif isinstance(value, pd.DataFrame):
            self._mark(f"table {value.shape}")
            self.add(value.index, within)
            for i, name in enumerate(value.columns):
                self.add(name, within)
                self._column(value.iloc[:, i], within)
            self.add(dict(value.attrs), within)
        elif isinstance(value, pd.Series):
            self._mark("series")
            self.add(value.index, within)
            self.add(value.name, within)
            self._column(value, within)
            self.add(dict(value.attrs), within)
        elif isinstance(value, pd.MultiIndex):
            self._mark(f"levels {value.nlevels}")
            for level in range(value.nlevels):
                self.add(value.get_level_values(level), within)
        elif isinstance(value, pd.Index):
            self.add(value.name, within)
            self._column(value, within)
        elif id(value) in within:
            self._mark("itself")
        else:
            self._container(value, (*within, id(value)))

    def _container(self, value: Any, within: tuple[int, ...]) -> None:
        if isinstance(value, Mapping):
            self._mark(f"mapping {len(value)}")
            for key, item in value.items():
                self.add(key, within)
                self.add(item, within)
        elif isinstance(value, (set, frozenset)):
            self.add(sorted(value, key=repr), within)
        elif isinstance(value, Iterable) and hasattr(value, "__len__"):
            self._mark(f"sequence {len(value)}")
            for item in value:
                self.add(item, within)
        elif callable(value) and hasattr(value, "__name__"):
            self._mark("function")
        else:
            self.add(parts(value), within)

    def _mark(self, words: str) -> None:
        self.bits.update(f"<{words}>".encode())

    def _scalar(self, value: Any) -> None:
        kind = "int" if isinstance(value, (int, np.integer)) else "float"
        kind = "truth" if isinstance(value, (bool, np.bool_)) else kind
        if value is None or np.iscomplexobj(value):
            self._mark(repr(value))
        else:
            self._mark(f"{kind} {float(value)!r}" if kind == "float" else f"{kind} {int(value)}")
            self.numbers.append(np.array([float(value)]))

    def _text(self, value: str) -> None:
        if any(letter.isspace() for letter in value):
            self._mark("prose")
            self.prose.update(value.encode() + b"\0")
            self.met_prose = True
        else:
            self._mark(f"name {value}")

    def _column(self, column: pd.Series | pd.Index, within: tuple[int, ...]) -> None:
        values = column.to_numpy()
        # Numbers as they are; text, which pandas stores in different ways, element by element.
        self._array(values if values.dtype.kind in "biufc" else values.astype(object), within)

    def _array(self, values: np.ndarray, within: tuple[int, ...]) -> None:
        if values.dtype.kind not in "biufc":
            self._mark(f"objects {values.shape}")
            for item in values.astype(object).ravel():
                self.add(item, within)
            return
        self._mark(f"array {values.dtype.str} {values.shape}")
        values = np.ascontiguousarray(values)
        self.bits.update(values.tobytes())
        flat = values.ravel()
        flat = flat.view(float) if flat.dtype == complex else flat.astype(float)
        self.numbers.append(flat)


def parts(value: Any) -> dict[str, Any]:
    """What an object shows: parameters and what was learned, or else its public attributes."""
    if hasattr(value, "get_params"):
        return value.get_params(deep=False) | learned(value)
    found = {name: shown(value, name) for name in dir(value) if not name.startswith("_")}
    return {name: item for name, item in found.items() if not callable(item)}


def learned(model: Any) -> dict[str, Any]:
    """Public fitted attributes of a model, by name."""
    names = [name for name in dir(model) if name.endswith("_") and not name.startswith("_")]
    found = {name: shown(model, name) for name in names}
    if found.get("covariance_") is not None:  # labelled or not: the numbers count
        found["covariance_"] = np.asarray(found["covariance_"])
    return {name: item for name, item in found.items() if not callable(item)}


def shown(value: Any, name: str) -> Any:
    """An attribute, or None where it is not available."""
    try:
        return getattr(value, name)
    except AttributeError:
        return None


def digested(value: Any) -> dict[str, list[str]]:
    """By group the checksum of a value, followed by its plain numbers."""
    digest = Digest()
    digest.add(value)
    found = {"bits": [digest.bits.hexdigest()[:16], *digest.plain()]}
    if digest.met_prose:
        found["text"] = [digest.prose.hexdigest()[:16]]
    return found
