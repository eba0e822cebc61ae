"""Questions that a method may have to answer, and what each data set says about them: a loss.

Open it to add a question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ....exceptions import did_you_mean
from .detection import alarm_times, threshold_of
from .figures import FOLLOWED, LOWEST_VAF, PARAMETERS

WORST = 100.0  # %, of a method without an estimate
DATA_SET = ["cell", "replication"]


@dataclass(frozen=True)
class Question:
    """A question, and how its loss is called.

    Parameters
    ----------
    name : str
        As given to functions.
    asks : str
        The question in words.
    loss : str
        What is smaller in a better method.
    unit : str
        Of the loss.
    """

    name: str
    asks: str
    loss: str
    unit: str

    def worded(self, parameter: str) -> str:
        """The question for a parameter.

        Returns
        -------
        text : str
        """
        return self.asks.format(parameter=parameter)


QUESTIONS = {
    question.name: question
    for question in (
        Question("follow", "follow {parameter} over time", "RMSE over time", "%"),
        Question("final", "find {parameter} after the change", "RMSE after the change", "%"),
        Question("detect", "see from K_edot that something changed", "time to the alarm", "s"),
        Question("predict", "predict the output", "validation VAF below 100 %", "points"),
        Question("delay", "follow the delay tau_e", "RMSE over time", "%"),
    )
}


def question_of(name: str) -> Question:
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

    Parameters
    ----------
    table : DataFrame
        Of a :class:`TournamentResult`.
    question : str
        One of ``QUESTIONS``.
    parameter : str, default="K_edot"
        For "follow" and "final".

    Returns
    -------
    losses : DataFrame
        A row for each data set (cell, replication), a column for each method that can answer.

    Raises
    ------
    ValueError
        If question or parameter are not known, or no data set answers the question.
    """
    name = question_of(question).name
    if parameter not in PARAMETERS:
        raise ValueError(
            f"parameter must be one of {list(PARAMETERS)}; got {parameter!r}."
            f"{did_you_mean(str(parameter), PARAMETERS)}"
        )
    shown = {"follow": parameter, "final": parameter, "delay": "tau_e"}.get(name, FOLLOWED)
    rows = table[table["parameter"] == shown]
    if name in ("final", "detect"):
        rows = rows[rows["kind"] == "changing"]
    if rows.empty:
        raise ValueError(
            f"No data set answers the question {name!r}"
            + (
                ": nothing changes in them."
                if name in ("final", "detect")
                else " (no method does)."
            )
        )
    if name == "predict":
        vaf = rows["vaf"].fillna(LOWEST_VAF).clip(lower=LOWEST_VAF)
        rows = rows.assign(loss=100.0 - vaf)
    elif name == "detect":
        rows = _alarms(rows, table)
    else:
        rows = rows.assign(loss=rows["rmse_after" if name == "final" else "rmse_all"].fillna(WORST))
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
            at = threshold_of((own if same.empty else same)["peak"].to_numpy())
            times = alarm_times(part, at)
            with np.errstate(invalid="ignore"):
                good = times >= part["change_begins"].to_numpy(float)
            left = part["change_left"].to_numpy(float)
            wait = np.where(good, np.abs(times - part["change_time"].to_numpy(float)), left)
            parts.append(part.assign(loss=wait))
    return pd.concat(parts)


def ranked(losses: pd.DataFrame) -> pd.DataFrame:
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
