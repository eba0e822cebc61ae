"""The runs of an exploration: their rows, names, people and what is measured in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ...metrics import scored_rows, vaf_of_rows
from ...pipelines import raw_layout
from ...preprocessing.gate import as_output
from ...regression import units_of
from ...runs import RunLayout, run_name
from ...runs.fingerprint import as_frame
from ...runs.roles import output_name, roles_of
from ...search.left_out import control_of, without_output

UNKNOWN = np.nan


@dataclass(frozen=True)
class Runs:
    """Data as they were given, and as rows of runs.

    ``y`` is missing where control was lost, in the stretches ``lost`` (run, from and to in s).
    """

    X: Any
    y: Any
    layout: RunLayout
    frame: pd.DataFrame
    measured: np.ndarray
    scored: np.ndarray
    lost: list[tuple[Any, float, float]]
    roles: dict[str, str]

    @classmethod
    def of(cls, estimator: Any, X: Any, y: Any, domain: str | None, lost_control: str) -> Runs:
        layout = raw_layout(estimator, X)
        control = control_of(estimator, X, lost_control, domain)
        kept = without_output(y, control)
        measured = as_output(kept)
        settling = float(getattr(estimator, "settling", 0.0)) or None
        scored = scored_rows(layout, settling, None) & ~np.isnan(measured)
        table = control.table
        lost = list(zip(table["run"], table["from"], table["to"], strict=True))
        frame = as_frame(X)
        run = getattr(estimator, "run", None)
        frame = frame.drop(columns=[run]) if run in list(frame.columns) else frame
        roles = roles_of(list(frame.columns), getattr(estimator, "roles", None))
        named = {str(name): role for name, role in roles.items()}
        return cls(X, kept, layout, frame, measured, scored, lost, named)

    @property
    def n(self) -> int:
        return len(self.layout.labels)

    @property
    def labels(self) -> list[str]:
        return [run_name(label) for label in self.layout.labels]

    @property
    def output(self) -> str:
        return output_name(self.y)

    @property
    def units(self) -> dict[str, str]:
        found = {**units_of(self.X), **units_of(self.y)}
        return {str(name): unit for name, unit in found.items()}

    def rows(self, run: int) -> slice:
        """Rows of a run."""
        a, b = self.layout.run_starts[run : run + 2].tolist()
        return slice(a, b)

    def length(self, run: int) -> int:
        """Number of rows of a run."""
        return int(self.layout.run_starts[run + 1] - self.layout.run_starts[run])

    def mask(self, runs: tuple[int, ...]) -> np.ndarray:
        """Rows of some runs."""
        chosen = np.zeros(self.n, dtype=bool)
        chosen[list(runs)] = True
        return np.repeat(chosen, np.diff(self.layout.run_starts))

    def part(self, runs: tuple[int, ...]) -> tuple[Any, Any]:
        """X and y of some runs, as they were given."""
        if len(runs) == self.n:
            return self.X, self.y
        rows = self.mask(runs)
        taken = [one[rows] if hasattr(one, "shape") else np.asarray(one)[rows] for one in self.both]
        for new, old in zip(taken, self.both, strict=True):
            if hasattr(old, "attrs"):
                new.attrs = dict(old.attrs)
        return taken[0], taken[1]

    @property
    def both(self) -> tuple[Any, Any]:
        return self.X, self.y

    def people(self) -> list[tuple[str, list[int]]]:
        """People and the numbers of their runs, where a level of the index names them."""
        index = getattr(self.X, "index", None)
        if index is None or "subject" not in index.names:
            return []
        names = index.get_level_values("subject")[self.layout.run_starts[:-1]]
        found: dict[str, list[int]] = {}
        for run, name in enumerate(names):
            found.setdefault(str(name), []).append(run)
        return list(found.items())

    def vaf(self, prediction: np.ndarray, runs: tuple[int, ...]) -> float | None:
        """VAF of some runs, as :func:`skhoid.vaf_score` has it, unclipped; None without rows."""
        keep = self.scored & self.mask(runs)
        if not keep.any() or not self.measured[keep].any():
            return None
        value = vaf_of_rows(self.measured, prediction, keep, self.layout, "pooled", False)
        return float(value)

    def vaf_by_run(self, prediction: np.ndarray) -> list[float | None]:
        """VAF of each run; None where nothing counts."""
        if not self.measured[self.scored].any():
            return [None] * self.n
        moves = np.add.reduceat(np.where(self.scored, self.measured**2, 0.0), self.begins) > 0
        keep = self.scored & np.repeat(moves, np.diff(self.layout.run_starts))
        found = vaf_of_rows(self.measured, prediction, keep, self.layout, None, False)
        return [float(v) if known else None for v, known in zip(found, moves, strict=True)]

    @property
    def begins(self) -> np.ndarray:
        """First rows of the runs."""
        return self.layout.run_starts[:-1]

    def rmse(self, prediction: np.ndarray, runs: tuple[int, ...]) -> float | None:
        keep = self.scored & self.mask(runs)
        if not keep.any():
            return None
        error = self.measured[keep] - np.clip(prediction[keep], -1e100, 1e100)
        return float(np.sqrt(np.mean(error**2)))
