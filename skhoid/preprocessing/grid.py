"""ModelGrid: the rows a model is fitted on, which the marks of a recording leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runs import RunLayout
from .filters import lowpass, to_full_rate


@dataclass(frozen=True)
class ModelGrid:
    """Stretches of the model's own sampling grid.

    ``begin`` and ``end`` are offsets into the grid rows; ``past`` is the first grid row of the
    same segment, from which inputs are known; ``measured`` is False in the run-in.
    """

    layout: RunLayout
    dt: float
    rows: np.ndarray | None
    begin: np.ndarray
    end: np.ndarray
    past: np.ndarray
    measured: np.ndarray

    @classmethod
    def of(cls, layout: RunLayout) -> ModelGrid:
        stretches = layout.stretches
        segment = layout.starts[np.searchsorted(layout.starts, stretches[:-1], side="right") - 1]
        trimmed = layout.trimmed
        measured = (
            np.ones(stretches.size - 1, dtype=bool)
            if trimmed is None
            else ~trimmed[np.minimum(stretches[:-1], max(layout.n_rows - 1, 0))]
        )
        if layout.mark is None or layout.kept is None:
            return cls(layout, layout.dt, None, stretches[:-1], stretches[1:], segment, measured)
        rows = np.flatnonzero(layout.kept)
        bounds = np.searchsorted(rows, stretches)
        some = bounds[1:] > bounds[:-1]
        return cls(
            layout,
            layout.dt * layout.mark.factor,
            rows,
            bounds[:-1][some],
            bounds[1:][some],
            np.searchsorted(rows, segment)[some],
            measured[some],
        )

    @property
    def n_rows(self) -> int:
        return self.layout.n_rows if self.rows is None else self.rows.size

    def thin_inputs(self, X: np.ndarray) -> np.ndarray:
        """Kept rows of inputs, which the Decimator has filtered already."""
        return X if self.rows is None else X[self.rows]

    def thin_output(self, y: np.ndarray) -> np.ndarray:
        """Filter and thin an output as the Decimator did the inputs."""
        if self.rows is None or self.layout.mark is None:
            return y
        return lowpass(y, self.layout.stretches, self.layout.mark)[self.rows]

    def to_full_rate(self, values: np.ndarray, wanted: np.ndarray | None = None) -> np.ndarray:
        """Bring values on the grid back to every row, or to the stretches of ``wanted`` rows."""
        if self.rows is None or self.layout.mark is None:
            return values
        return to_full_rate(values, self.rows, self.layout.stretches, self.layout.mark, wanted)

    def full_row(self, grid_row: int) -> int:
        return grid_row if self.rows is None else int(self.rows[grid_row])
