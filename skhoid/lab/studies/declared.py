"""What the studies of the thesis are declared by, and what they find: cells, claims, results."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...io import check_table_format, save_figure, write_tables
from ...simulation import ORDERS
from .monte_carlo import MonteCarloStudy

CONDITIONS: tuple[str, ...] = ("C1", "C2", "C3", "C4", "C5", "C6")
STATES: tuple[str, ...] = ("C1", "C2")  # constant dynamics
INTENSITIES: tuple[float, ...] = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30)  # P_n


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis, compared with what a study found.

    Parameters
    ----------
    source : str
        Figure or section.
    statement : str
        What the thesis says.
    found : str
        What the study found, in numbers.
    holds : bool or None
        Whether it holds; None if the cells or replications do not allow a judgement.
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
    """What a study of the thesis found.

    Parameters
    ----------
    name : str
        As in ``skhoid study NAME``.
    title : str
        One sentence.
    table : DataFrame
        One row per replication and setting.
    summary : DataFrame
        Means and deviations by cell.
    claims : list of Claim
        Statements of the thesis, and whether they hold here.
    figures : dict of str to callable
        Functions that draw the thesis's figures, by name.
    """

    name: str
    title: str
    table: pd.DataFrame
    summary: pd.DataFrame
    claims: list[Claim]
    figures: dict[str, Callable[[], Any]]

    def __str__(self) -> str:
        return "\n".join([self.title, *map(str, self.claims)])

    def __repr__(self) -> str:
        return f"StudyResult({self.name!r}, {len(self.table)} rows, {len(self.claims)} claims)"

    def plot(self) -> dict[str, Any]:
        """Draw the thesis's figures."""
        return {name: draw().figure_ for name, draw in self.figures.items()}

    def save(
        self, folder: str | os.PathLike[str], *, figures: bool = True, table_format: str = "csv"
    ) -> list[Path]:
        """Write table, summary, claims and figures into a folder; the files are returned.

        ``table_format`` is "csv", "tsv" or "parquet" (which needs ``pip install "skhoid[io]"``).
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


# Options that make the cells of a study, and what they are called there.
OF_CELLS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "conditions": ("condition", str),
    "orders": ("remnant_order", lambda order: order),
    "intensities": ("remnant_intensity", float),
    "sampling_rates": ("sampling_rate", float),
    "open_loop": ("open_loop", bool),
}


@dataclass(frozen=True)
class PaperStudy:
    """A study of the thesis: what is simulated, and what is made of the table without failures.

    ``what`` it shows in a few words, ``title`` in a sentence; ``options`` are its own with their
    defaults. Those that define neither cells nor the simulation are settings of ``function``.
    ``summarize`` makes means by cell, ``judge`` claims of summary and table, ``draw`` functions
    that draw the figures, by name. ``shown`` are prefixes of the names of its figures; empty: all.
    """

    what: str
    title: str
    options: Mapping[str, Any]
    function: Callable[..., Any]
    summarize: Callable[[pd.DataFrame], pd.DataFrame]
    judge: Callable[[pd.DataFrame, pd.DataFrame], Iterator[Claim]]
    draw: Callable[[pd.DataFrame], dict[str, Any]]
    shown: tuple[str, ...] = ()
    simulation: Mapping[str, Any] = field(default_factory=dict)
    study: Mapping[str, Any] = field(default_factory=dict)

    def showing(self, what: str, *shown: str, **options: Any) -> PaperStudy:
        """The same study with other figures, by prefixes of their names, and options."""
        return replace(self, what=what, shown=shown, options={**self.options, **options})

    def declare(self, n_replications: int, random_state: Any, **given: Any) -> MonteCarloStudy:
        """The study with some options given."""
        options = {**self.options, **given}
        n_validation = options.pop("n_validation", 0)
        horizons = options.get("memory_horizons", (np.inf,))
        if np.inf not in horizons or min(horizons) <= 1:
            raise ValueError(
                f"memory_horizons must be above 1 and include infinity (no forgetting), with which "
                f"the others are compared; got {list(horizons)}."
            )
        simulation = dict(self.simulation) | _gains(options.pop("gains"), options["intensities"])
        if "remnant_order" in options:
            (simulation["remnant_order"],) = _known_orders([options.pop("remnant_order")])
        if "orders" in options:
            options["orders"] = _known_orders(options["orders"])
        cells = {
            name: list(map(kind, options.pop(option)))
            for option, (name, kind) in OF_CELLS.items()
            if option in options
        }
        return MonteCarloStudy(
            partial(self.function, **options) if options else self.function,
            cells,
            n_replications,
            n_validation_runs=n_validation,
            simulation=simulation,
            random_state=random_state,
            **self.study,
        )


def _known_orders(orders: Sequence[Any]) -> list[Any]:
    """Orders of the remnant filter; numbers may be given as text."""
    known = {str(order): order for order in ORDERS}
    unknown = [order for order in orders if str(order) not in known]
    if unknown:
        raise ValueError(
            f"Orders of the remnant filter must be among {list(known)}; got {unknown[0]!r}."
        )
    return [known[str(order)] for order in orders]


def _gains(gains: str, intensities: Sequence[float]) -> dict[str, Any]:
    """Options of the simulation for where the remnant's gains come from."""
    if gains not in ("table", "tuned"):
        raise ValueError(f"gains must be 'table' (Table G.1) or 'tuned'; got {gains!r}.")
    strange = [P_n for P_n in intensities if not np.isclose(P_n, INTENSITIES).any()]
    if gains == "table" and strange:
        raise ValueError(
            f"Table G.1 has gains for P_n = 0.05, 0.10 ... 0.30; got {strange[0]:g}. For any "
            "other, use gains='tuned' (--gains tuned)."
        )
    return {"remnant_gain": "table"} if gains == "table" else {}


def range_text(values: Any, digits: int = 2, sign: bool = False) -> str:
    """Smallest and largest value as text."""
    values = np.asarray(values, dtype=float)
    low, high = np.nanmin(values), np.nanmax(values)
    form = f"{{:{'+' if sign else ''}.{digits}f}}"
    if form.format(low) == form.format(high):
        return form.format(low)
    return f"{form.format(low)} to {form.format(high)}"
