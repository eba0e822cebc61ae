"""TournamentResult: what each method made of each condition, and which to use when."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ...exceptions import did_you_mean
from ...io import check_table_format, save_figure, write_tables
from ...text import Document, Item, Items, Paragraph, TextTable, Told
from .tournament_scores import ALARMS, FOLLOWED, LOWEST_VAF, PARAMETERS, THRESHOLDS

WORST_LOSS = 100.0  # %, of a method without an estimate
DATA_SET = ["cell", "replication"]
FALSE_ALARMS = 0.1


class Question(NamedTuple):
    """A question in words, what is smaller in a better method, and the unit of that."""

    asks: str
    loss: str
    unit: str


QUESTIONS = {
    "follow": Question("follow {parameter} over time", "RMSE over time", "%"),
    "final": Question("find {parameter} after the change", "RMSE after the change", "%"),
    "detect": Question("see from K_edot that something changed", "time to the alarm", "s"),
    "predict": Question("predict the output", "validation VAF below 100 %", "points"),
    "delay": Question("follow the delay tau_e", "RMSE over time", "%"),
}


def find_question(name: str) -> Question:
    """A question by its name."""
    if name not in QUESTIONS:
        raise ValueError(
            f"question must be one of {list(QUESTIONS)}; got {name!r}."
            f"{did_you_mean(str(name), QUESTIONS)}"
        )
    return QUESTIONS[name]


def losses(table: pd.DataFrame, question: str, parameter: str = FOLLOWED) -> pd.DataFrame:
    """Loss of each method on each data set; NaN where a method has not been tried.

    A method that gives no estimate has the largest loss there is: 100 %, a VAF of -100 %, or an
    alarm at the end of the run. An alarm before 5 % of the change counts as one at the end too.
    """
    find_question(question)
    if parameter not in PARAMETERS:
        raise ValueError(
            f"parameter must be one of {list(PARAMETERS)}; got {parameter!r}."
            f"{did_you_mean(str(parameter), PARAMETERS)}"
        )
    shown = {"follow": parameter, "final": parameter, "delay": "tau_e"}.get(question, FOLLOWED)
    rows = table[table["parameter"] == shown]
    if question in ("final", "detect"):
        rows = rows[rows["kind"] == "changing"]
    if rows.empty:
        raise ValueError(
            f"No data set answers the question {question!r}"
            + (
                ": nothing changes in them."
                if question in ("final", "detect")
                else " (no method does)."
            )
        )
    if question == "predict":
        vaf = rows["vaf"].fillna(LOWEST_VAF).clip(lower=LOWEST_VAF)
        rows = rows.assign(loss=100.0 - vaf)
    elif question == "detect":
        rows = _alarms(rows, table)
    else:
        rows = rows.assign(
            loss=rows["rmse_after" if question == "final" else "rmse_all"].fillna(WORST_LOSS)
        )
    order = [method for method in dict.fromkeys(table["method"]) if method in set(rows["method"])]
    cells = list(dict.fromkeys(rows["cell"]))
    wide = rows.pivot(index=DATA_SET, columns="method", values="loss")
    return wide[order].reindex(cells, level="cell")


def _alarms(rows: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    """Rows of changed runs with the time to the alarm, at one false alarm in ten."""
    quiet = table[(table["parameter"] == FOLLOWED) & (table["kind"] == "constant")]
    if quiet.empty:
        raise ValueError(
            "The question 'detect' needs cells in which nothing changes, for its false alarms."
        )
    parts = []
    for method, of_method in rows.groupby("method", sort=False):
        own = quiet[quiet["method"] == method]
        for P_n, part in of_method.groupby("group", sort=False):
            same = own[own["group"] == P_n.replace("changing", "constant")]
            at = find_threshold((own if same.empty else same)["peak"].to_numpy())
            times = alarm_times(part, at)
            with np.errstate(invalid="ignore"):
                good = times >= part["change_begins"].to_numpy(float)
            left = part["change_left"].to_numpy(float)
            wait = np.where(good, np.abs(times - part["change_time"].to_numpy(float)), left)
            parts.append(part.assign(loss=wait))
    return pd.concat(parts)


def rank(losses: pd.DataFrame) -> pd.DataFrame:
    """Methods by the median over cells of their median loss in a cell, the best first.

    ``won`` is the share of cells in which a method's median loss is the lowest, in %, ``n`` the
    number of its data sets.
    """
    of_cells = losses.groupby("cell", sort=False).median()
    winner = of_cells.dropna(how="all").idxmin(axis=1)
    found = pd.DataFrame(
        {
            "loss": of_cells.median(),
            "mean": of_cells.mean(),
            "worst": of_cells.max(),
            "won": 100.0 * winner.value_counts(normalize=True).reindex(losses.columns).fillna(0.0),
            "n": losses.count(),
        }
    )
    found.index.name = "method"
    return found.sort_values(["loss", "mean"], kind="stable")


def roc_area(changed: np.ndarray, constant: np.ndarray) -> float:
    """Area under the ROC of peaks: the share of pairs in which the changed run has the larger one.

    Runs without an estimate count as peaks of zero (Mann and Whitney; Hanley and McNeil 1982).
    """
    changed, constant = (np.nan_to_num(np.asarray(x, float)) for x in (changed, constant))
    if not changed.size or not constant.size:
        return np.nan
    larger = (changed[:, None] > constant).mean()
    return float(larger + 0.5 * (changed[:, None] == constant).mean())


def find_threshold(constant: np.ndarray) -> int | None:
    """Position of the first threshold that at most one in ten constant runs exceeds."""
    constant = np.nan_to_num(np.asarray(constant, float))
    if not constant.size:
        return None
    shares = (constant[:, None] >= THRESHOLDS).mean(axis=0)
    enough = np.flatnonzero(shares <= FALSE_ALARMS)
    return int(enough[0]) if enough.size else None


def detect(table: pd.DataFrame) -> pd.DataFrame:
    """Detection by method and remnant intensity, from rows of K_edot.

    ``roc_area``; and at one false alarm in ten ``threshold``, the shares ``found``, ``missed`` and
    ``too_early`` (before ``change_begins``) of changed runs, and the median ``delay`` of those
    found after the middle of the change, in s.
    """
    rows = []
    keys = ["method", *(["remnant_intensity"] if "remnant_intensity" in table else [])]
    for key, part in table.groupby(keys, sort=False, dropna=False):
        changed, constant = part[part["kind"] == "changing"], part[part["kind"] == "constant"]
        if changed.empty or constant.empty:
            continue
        at = find_threshold(constant["peak"].to_numpy())
        times = alarm_times(changed, at)
        early = times < changed["change_begins"].to_numpy(float)
        missed = np.isnan(times)
        delay = (times - changed["change_time"].to_numpy(float))[~early & ~missed]
        rows.append(
            dict(zip(keys, key, strict=True))
            | {
                "roc_area": roc_area(changed["peak"].to_numpy(), constant["peak"].to_numpy()),
                "threshold": np.nan if at is None else float(THRESHOLDS[at]),
                "found": float((~early & ~missed).mean()),
                "missed": float(missed.mean()),
                "too_early": float(early.mean()),
                "delay": float(np.median(delay)) if delay.size else np.nan,
            }
        )
    return pd.DataFrame(rows).set_index(keys) if rows else pd.DataFrame()


def alarm_times(rows: pd.DataFrame, threshold: int | None) -> np.ndarray:
    """When each run gives its alarm at a threshold; NaN if it gives none."""
    if threshold is None:
        return np.full(len(rows), np.nan)
    return rows[ALARMS[threshold]].to_numpy(float)


KINDS = {True: "Causal", False: "Offline"}
SHOWN = ("bias", "sd", "rmse", "settling", "vaf")  # of K_edot, in the text
PICTURES = ("winners", "bias", "settling")


@dataclass(frozen=True, eq=False, repr=False)
class TournamentResult(Told):
    """What a tournament of methods found.

    Parameters
    ----------
    table : DataFrame
        A row for each data set, method and parameter. Of the relative error over time, in %, in the
        windows ``_all``, ``_before``, ``_around`` and ``_after`` the change: ``bias_``, ``rmse_``,
        ``median_error_``, ``failed_`` (instants without an estimate), ``coverage_`` (of the stated
        95 % intervals). Of the data set: ``vaf`` on validation runs, ``diverged``, ``failure`` (the
        error message). Of K_edot: ``settling`` and ``lag`` in s, ``peak`` and ``alarm_``.
    tuning : DataFrame
        Mean validation VAF of each setting in each group of cells, the share of data sets in % on
        which it ``failed``, and which setting was ``chosen``.
    methods : DataFrame
        By method: ``label``, ``causal``, ``knob``, ``n_settings``, ``told``, ``n_replications``,
        and whether it is an ``oracle``, which is shown but not ranked.
    cost : Series
        Microseconds per sample of a fit, on the machine of this tournament.
    notes : list of str
        Methods that could not take part.
    """

    table: pd.DataFrame
    tuning: pd.DataFrame
    methods: pd.DataFrame
    cost: pd.Series
    notes: list[str] = field(default_factory=list)

    def ranking(
        self, question: str = "follow", *, causal: bool | None = None, parameter: str = FOLLOWED
    ) -> pd.DataFrame:
        """Methods in the order in which they answer a question.

        Parameters
        ----------
        question : {"follow", "final", "detect", "predict", "delay"}, default="follow"
            RMSE over time of a parameter; RMSE after the change; time to the alarm after the
            change; 100 % less the validation VAF; RMSE over time of tau_e.
        causal : bool or None, default=None
            Only causal methods, or only offline ones.
        parameter : str, default="K_edot"
            For "follow" and "final".

        Returns
        -------
        ranking : DataFrame
            By method, the best first: ``loss``, the median over cells of the median in a cell,
            ``mean`` and ``worst`` over cells, ``won``, the share of cells in % in which it is the
            lowest of those ranked, and ``n`` data sets.
        """
        return rank(self._losses(question, causal, parameter))

    def best(
        self, question: str = "follow", *, causal: bool | None = None, parameter: str = FOLLOWED
    ) -> str:
        """The name of the method that answers a question best; options as of :meth:`ranking`."""
        return str(self.ranking(question, causal=causal, parameter=parameter).index[0])

    def winners(
        self, question: str = "follow", *, causal: bool | None = None, parameter: str = FOLLOWED
    ) -> pd.DataFrame:
        """By cell the method with the lowest median loss, and the next one.

        Options are those of :meth:`ranking`. Columns are ``method``, ``loss``, ``next``,
        ``next_loss``, and what describes the cell.
        """
        of_cells = self._losses(question, causal, parameter).groupby("cell", sort=False).median()
        rows = []
        for cell, values in of_cells.iterrows():
            order = values.dropna().sort_values(kind="stable")
            second = order.index[1] if len(order) > 1 else None
            rows.append(
                {
                    "cell": cell,
                    "method": order.index[0],
                    "loss": order.iloc[0],
                    "next": second,
                    "next_loss": np.nan if second is None else order[second],
                }
            )
        return pd.DataFrame(rows).set_index("cell").join(self.cells)

    @property
    def cells(self) -> pd.DataFrame:
        """What describes each cell, by its name."""
        columns = list(self.table.columns)
        before = columns[: columns.index("replication")]
        return self.table[before].drop_duplicates("cell").set_index("cell")

    def by_cell(self, window: str = "all") -> pd.DataFrame:
        """Bias, standard deviation, RMSE and more of each method in each cell.

        Parameters
        ----------
        window : {"all", "before", "around", "after"}, default="all"
            Part of the run.

        Returns
        -------
        summary : DataFrame
            By cell, method and parameter, in %: ``bias``, the mean over data sets and time;
            ``sd``, the deviation from it, over both; ``rmse``, the median over data sets;
            ``median_error``, ``failed``, ``coverage``; ``vaf`` (median), ``diverged`` (share of
            data sets in %); ``settling`` and ``lag`` in s (medians).
        """
        keys = ["cell", "method", "parameter"]
        rows = self.table.dropna(subset="parameter")
        rows = rows.assign(
            square=rows[f"rmse_{window}"] ** 2, diverged=100.0 * rows["diverged"].astype(float)
        )
        grouped = rows.groupby(keys, sort=False)
        bias = grouped[f"bias_{window}"].mean()
        found = {
            "bias": bias,
            "sd": np.sqrt((grouped["square"].mean() - bias**2).clip(lower=0.0)),
            "rmse": grouped[f"rmse_{window}"].median(),
            "median_error": grouped[f"median_error_{window}"].median(),
            "failed": grouped[f"failed_{window}"].mean(),
            "coverage": grouped[f"coverage_{window}"].mean(),
            "vaf": grouped["vaf"].median(),
            "diverged": grouped["diverged"].mean(),
            "settling": grouped["settling"].median(),
            "lag": grouped["lag"].median(),
        }
        return pd.DataFrame(found)

    def by_method(self, window: str = "all") -> pd.DataFrame:
        """The same of each method and parameter, as medians over cells.

        Of the size of the bias too; means of ``failed``, ``coverage`` and ``diverged``.
        """
        found = self.by_cell(window)
        grouped = found.assign(bias=found["bias"].abs()).groupby(
            ["method", "parameter"], sort=False
        )
        means = ["failed", "coverage", "diverged"]
        return grouped.median().assign(**{name: grouped[name].mean() for name in means})

    def detection(self) -> pd.DataFrame:
        """How well changes are seen in K_edot(t), by method and remnant intensity; see detect."""
        return detect(self.table[self.table["parameter"] == FOLLOWED])

    def _losses(self, question: str, causal: bool | None, parameter: str) -> pd.DataFrame:
        """Losses of the methods that are ranked: not those of oracles."""
        find_question(question)
        kept = ~self.methods["oracle"].astype(bool)
        if causal is not None:
            kept &= self.methods["causal"] == causal
        rows = self.table[self.table["method"].isin(self.methods.index[kept])]
        if rows.empty:
            kind = "" if causal is None else f"{KINDS[causal].lower()} "
            raise ValueError(f"No {kind}method took part that could be ranked.")
        return losses(rows, question, parameter)

    def __repr__(self) -> str:
        return str(self.summary())

    def document(self) -> Document:
        """Use this when, in plain words, with the figures behind it."""
        n_sets = len(self.table.drop_duplicates(["cell", "replication"]))
        title = (
            f"{len(self.methods)} methods on {len(self.cells)} conditions, {n_sets} simulated "
            "runs; tuned by validation VAF on other runs."
        )
        advice = Items([Item(text) for text in self._advice()], numbered=False)
        remarks = [Paragraph(text) for text in [*self._remarks(), *self.notes]]
        return Document(title, [advice, *self._tables(), *remarks])

    def _advice(self) -> list[str]:
        lines = []
        for causal in (True, False):
            for name, question in QUESTIONS.items():
                try:
                    found = self.ranking(name, causal=causal)
                except ValueError:
                    continue
                asked = question.asks.format(parameter=FOLLOWED)
                first = found.iloc[0]
                text = (
                    f"{KINDS[causal]}, to {asked}: {found.index[0]} ({question.loss} "
                    f"{first['loss']:.3g} {question.unit}"
                )
                if len(found) > 1:
                    text += f", best in {first['won']:.0f} % of cells"
                others = found.iloc[1:3]
                text += "".join(f"; {m} {row['loss']:.3g}" for m, row in others.iterrows())
                lines.append(f"{text}).")
        return lines

    def _tables(self) -> list[TextTable]:
        tables = []
        summary, detected = self.by_method(), self.detection()
        for causal in (True, False):
            names = self.methods.index[self.methods["causal"] == causal]
            rows = []
            for name in names:
                if (name, FOLLOWED) not in summary.index:
                    continue
                of = summary.loc[(name, FOLLOWED)]
                area = delay = np.nan
                if len(detected) and name in detected.index:
                    area, delay = detected.loc[name, ["roc_area", "delay"]].median()
                rows.append(
                    [
                        name, *(_shown(of[k], 1) for k in SHOWN),
                        _shown(area, 3), _shown(delay, 1), _shown(of["coverage"], 0),
                        _shown(of["diverged"], 1), _shown(self.cost.get(name, np.nan), 1),
                    ]
                )  # fmt: skip
            if rows:
                header = ["", "bias", "sd", "RMSE", "settles", "VAF", "ROC", "alarm", "cover",
                          "div.", "µs"]  # fmt: skip
                caption = f"{KINDS[causal]} methods: K_edot over time"
                tables.append(TextTable(caption, header, rows))
        return tables

    def _remarks(self) -> list[str]:
        failed = self.table["failure"].notna()
        remarks = [
            "bias (its size), sd and RMSE in % of the truth, medians over cells; settles: s after "
            "the change; alarm: s after the change with one false alarm in ten; cover: % of the "
            "time in the stated 95 % interval; div.: % of runs that diverged; µs per sample on the "
            "machine that ran it."
        ]
        if failed.any():
            rows = self.table[failed].drop_duplicates(["method", "cell", "replication"])
            counts = rows["method"].value_counts()
            told = ", ".join(f"{name} {n}" for name, n in counts.items())
            remarks.append(f"Fits that failed: {told}; the column failure says why.")
        failing = self.tuning[self.tuning["failed"] > 0].drop_duplicates(["method", "setting"])
        if len(failing):
            told = ", ".join(f"{m} ({s})" for m, s in failing[["method", "setting"]].to_numpy())
            remarks.append(f"Settings that failed on some data sets of the tuning: {told}.")
        if self.table["error"].notna().any():
            remarks.append("Some runs could not be simulated; the column error says why.")
        return remarks

    def settling(self) -> pd.DataFrame:
        """How soon each method has settled after a change, and how noisy it is before.

        Returns
        -------
        settling : DataFrame
            By ``method`` and ``remnant_intensity``, of K_edot in runs with a change: medians of
            ``noise`` (RMSE before it, %) and ``settling`` (s; infinite where it never does).
        """
        rows = self.table[self.table["parameter"].eq(FOLLOWED) & self.table["kind"].eq("changing")]
        if rows.empty:
            raise ValueError("Nothing changes in the runs of this tournament.")
        rows = rows.assign(remnant_intensity=rows.get("remnant_intensity", np.nan))
        rows = rows.rename(columns={"rmse_before": "noise"})
        grouped = rows.groupby(["method", "remnant_intensity"], sort=False, dropna=False)
        return grouped[["noise", "settling"]].median().reset_index()

    def plot(self, kind: str = "winners", *, ax: Any = None) -> Any:
        """Draw it by :meth:`skhoid.plotting.TournamentDisplay.from_result`.

        ``kind`` is "winners" (the best method by cell), "bias" (against the standard deviation, by
        method) or "settling" (error before and settling time after the change).
        """
        from ...plotting import TournamentDisplay

        return TournamentDisplay.from_result(self, kind, ax=ax)

    def save(
        self, folder: str | os.PathLike[str], *, figures: bool = True, table_format: str = "csv"
    ) -> list[Path]:
        """Write all tables, and the three figures, into a folder; the files are returned.

        ``table_format`` is "csv", "tsv" or "parquet" (which needs ``pip install "skhoid[io]"``).
        """
        check_table_format(table_format)
        packed = "" if table_format == "parquet" else ".gz"
        tables = {
            f"table.{table_format}{packed}": self.table,
            f"tuning.{table_format}": self.tuning,
            f"methods.{table_format}": self.methods,
            f"cost.{table_format}": self.cost.rename_axis("method").to_frame(),
            f"summary.{table_format}": self.by_method(),
            f"by_cell.{table_format}": self.by_cell(),
        }
        files = write_tables(tables, Path(folder))
        if figures:
            for kind in PICTURES:
                path = Path(folder) / f"{kind}.png"
                files.append(save_figure(self.plot(kind).figure_, path))
        return files


def _shown(value: float, digits: int) -> str:
    if np.isnan(value):
        return "-"
    return "never" if np.isinf(value) else f"{value:.{digits}f}"
