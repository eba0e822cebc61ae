"""What the paper's studies have in common: their cells, claims, and results."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..io.figures import save_figure
from ..io.tables import check_table_format, write_tables
from ..simulation.loop import CompensatoryTask
from ..simulation.physics import response_of
from ..simulation.remnant import ORDERS

CONDITIONS = ("C1", "C2", "C3", "C4", "C5", "C6")
STATES = ("C1", "C2")  # constant dynamics
INTENSITIES = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30)  # P_n
KEPT = 1.0  # s kept of the run-in, so that shifted signals have a past; more for long delays
FIRST_PART = 30.72  # s: first and last part of a run, in which nothing changes
EARLIER, LATER = 0.13, 0.20  # s: n_k / f_s from so much below tau_e to so much above are tried
PARAMETERS = ("a1", "a2", "b0", "b1")


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis beside what a study found.

    Parameters
    ----------
    source : str
        Figure or section.
    statement : str
        What the thesis says.
    found : str
        What the study found, in numbers.
    holds : bool or None
        Whether it holds; None where it cannot be judged with the cells or replications at hand.

    Examples
    --------
    >>> from skhoid.montecarlo import Claim
    >>> print(Claim("Fig. 9", "n_k* = 29 without remnant", "29 in C1 and C2", True))
    [holds] Fig. 9: n_k* = 29 without remnant. Found: 29 in C1 and C2.
    """

    source: str
    statement: str
    found: str
    holds: bool | None

    def __str__(self) -> str:
        verdict = {True: "holds", False: "does not hold", None: "not judged"}[self.holds]
        return f"[{verdict}] {self.source}: {self.statement}. Found: {self.found}."


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What a study of the paper found.

    Parameters
    ----------
    name : str
        As in ``skhoid study NAME``.
    title : str
        In a sentence.
    table : DataFrame
        A row for each replication and setting.
    summary : DataFrame
        Means and deviations by cell.
    claims : list of Claim
        Statements of the thesis, and whether they hold here.
    figures : dict of str to callable
        Functions that draw the thesis's figures, by name.
    notes : list of str
        What else there is to say.

    Examples
    --------
    >>> from skhoid.montecarlo import delay_study
    >>> found = delay_study(2, orders=["nm"], intensities=[0.0, 0.1], conditions=["C1"])
    >>> print(found.claims[0])
    [holds] Fig. 9: without remnant n_k* = n_k^0. Found: 29 where it is 29.
    """

    name: str
    title: str
    table: pd.DataFrame
    summary: pd.DataFrame
    claims: list[Claim]
    figures: Mapping[str, Callable[[], Any]]
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return "\n".join([self.title, *map(str, self.claims), *self.notes])

    def __repr__(self) -> str:
        return f"StudyResult({self.name!r}, {len(self.table)} rows, {len(self.claims)} claims)"

    def plot(self) -> dict[str, Any]:
        """Draw the thesis's figures.

        Returns
        -------
        figures : dict of str to matplotlib Figure
        """
        return {name: draw().figure_ for name, draw in self.figures.items()}

    def save(
        self, folder: str | os.PathLike[str], *, figures: bool = True, table_format: str = "csv"
    ) -> list[Path]:
        """Write table, summary, claims and figures.

        Parameters
        ----------
        folder : path
            Made if it is not there.
        figures : bool, default=True
            Also draw.
        table_format : {"csv", "tsv", "parquet"}, default="csv"
            Of the tables; Parquet needs ``pip install "skhoid[io]"``.

        Returns
        -------
        files : list of Path
            ``table.csv.gz``, ``summary.csv``, ``claims.csv``, or with the other endings, and PNG
            files.
        """
        check_table_format(table_format)
        folder = Path(folder)
        packed = "" if table_format == "parquet" else ".gz"
        tables = {
            f"table.{table_format}{packed}": self.table,
            f"summary.{table_format}": self.summary,
            f"claims.{table_format}": pd.DataFrame([asdict(claim) for claim in self.claims]),
        }
        files = write_tables(tables, folder)
        if figures:
            for name, draw in self.figures.items():
                files.append(save_figure(draw().figure_, folder / f"{name}.png"))
        return files


def checked_orders(orders: Sequence[Any]) -> list[Any]:
    """Orders of the remnant filter, numbers also as text."""
    known = {str(order): order for order in ORDERS}
    unknown = [order for order in orders if str(order) not in known]
    if unknown:
        raise ValueError(f"Orders of the remnant filter are {list(known)}; got {unknown[0]!r}.")
    return [known[str(order)] for order in orders]


def gains_of(gains: str, intensities: Sequence[float]) -> dict[str, Any]:
    """Options of the simulation for where the remnant's gains come from."""
    if gains not in ("table", "tuned"):
        raise ValueError(f"gains is 'table' (Table G.1) or 'tuned'; got {gains!r}.")
    strange = [P_n for P_n in intensities if not np.isclose(P_n, INTENSITIES).any()]
    if gains == "table" and strange:
        raise ValueError(
            f"Table G.1 has gains for P_n = 0.05, 0.10 ... 0.30; got {strange[0]:g}. With "
            "gains='tuned' (--gains tuned) they are found for any."
        )
    return {"remnant_gain": "table"} if gains == "table" else {}


def candidate_delays(task: CompensatoryTask) -> np.ndarray:
    """n_k around the operator's delay: from 0.15 to 0.48 s in the conditions of the thesis."""
    delay = response_of(task).delay_time
    shortest, longest = (round((delay + apart) * task.sampling_rate) for apart in (-EARLIER, LATER))
    return np.arange(max(shortest, 1), longest + 1)


def kept_run_in(task: CompensatoryTask) -> float:
    """Seconds of the run-in that shifting by any of the candidate delays needs."""
    kept = max(KEPT, response_of(task).delay_time + 2 * LATER)
    there = task.n_run_in / task.sampling_rate
    if there < kept:
        raise ValueError(
            f"The task has a run-in of {there:g} s; {kept:g} s are needed, so that the error is "
            "known one delay before the measurement window. Give it run_in=None or more."
        )
    return kept


def succeeded(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of data sets that did not fail."""
    return table[table["error"].isna()]


def shifted(e: np.ndarray, before: int, nk: int, extra: int = 0) -> np.ndarray:
    """e(t - n_k) of the window, of shape (n_runs, extra + n_samples), from run-in and window."""
    return e[:, before - nk - extra : e.shape[1] - nk]


def span(values: Any, digits: int = 2, sign: bool = False) -> str:
    """Smallest and largest value in words."""
    values = np.asarray(values, dtype=float)
    low, high = np.nanmin(values), np.nanmax(values)
    form = f"{{:{'+' if sign else ''}.{digits}f}}"
    if form.format(low) == form.format(high):
        return form.format(low)
    return f"{form.format(low)} to {form.format(high)}"
