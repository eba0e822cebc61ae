"""What the analysis of an experiment found, as tables and as text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from ...runs import RUN
from ...text import (
    Block,
    Document,
    Heading,
    Item,
    Items,
    Note,
    Notes,
    Paragraph,
    TextTable,
    Told,
    as_sentence,
    counted,
)
from .groups import ALL, CONDITION, SUBJECT, listed, runs_of_each

SIGNIFICANT = 0.005  # of each of two gains, so that a cell is wrong in 1 % of cases
ENOUGH = 4  # runs, below which only large changes can be significant
UNCHANGED = 0.01  # p of the batch a1 and a2, above which they are taken as the same
STILL = 0.6  # variation of a1 and a2, relative to that of b0 and b1, below which they hold still
WORSE = 0.5  # VAF points that Lambda may lose on other runs
SCORES = ("rms_e", "tracking_score", "control_activity")


@dataclass(frozen=True, repr=False)
class ExperimentResult(Told):
    """What :func:`analyse_experiment` found.

    All tables begin with the columns ``subject`` and ``condition`` (``"all"`` where the data have
    no such level).

    Parameters
    ----------
    paths : DataFrame
        Recursive estimates over time: ``run`` (or ``"mean"``), ``form`` (``"lambda"`` or
        ``"Lambda"``), ``time`` (s), a1, a2, b0, b1, K_e, T_L (s), K_edot (s), omega_nm (rad/s),
        zeta_nm; NaN where the poles are not a complex pair. The mean is that of the ARX parameters;
        its operator parameters are converted from it.
    batch : DataFrame
        Batch models of the first (``form`` ``"ini"``) and the last region (``"fin"``): ``run``,
        ``start`` and ``stop`` (s), the same parameters, and ``sd_...``: for a run that of its fit,
        for the mean that over the runs.
    scores : DataFrame
        Result of :func:`performance_scores` for each run and window.
    validation : DataFrame
        ``run``, ``form`` (also ``"constant"``, a batch model of the whole run), ``window``
        (``"T_m"`` or ``"tran"``), ``vaf_estimation``, and ``vaf_validation``, the mean over the
        other runs of the free run along the path of this one; in percent, 0 at least for each run.
    changes : DataFrame
        Each ``parameter`` in the last compared with the first region: means ``ini`` and ``fin`` of
        the batch estimates, ``change``, ``t`` and ``p`` of a paired t test over ``n_runs``; and
        ``variation``: the standard deviation over time of the mean path of ``"lambda"``, divided by
        that which the scatter of the runs explains (about 1 where nothing changes).
    delays : DataFrame
        ``nk``, ``delay`` (s), and whether it was ``searched``.
    verdicts : DataFrame
        ``adapts`` (None with a single run), ``gains`` (a tuple: which of K_e and K_edot change),
        ``variation_a``, ``variation_b``, ``gain_lambda`` and ``gain_Lambda`` (VAF points on other
        runs in the transition: λ over constant parameters, Λ over λ), and ``Lambda``:
        ``"justified"``, ``"not justified"``, ``"no need"`` where nobody adapts, or
        ``"unknown"``; ``reason`` says why not.
    notes : list of str
        What is missing, and how that was handled.
    dt : float
        Sampling time (s).
    memory_horizon : float
        N0 in samples.
    region : float
        Length of the first and the last region (s).
    transition_times : dict
        Time at which the controlled element changes, by condition (s), where known.

    Notes
    -----
    A subject adapts if K_e or K_edot changes with p < 0.005 (b0 or b1 where the poles are real),
    which happens by chance in 1 % of cases. This needs enough runs: with five the mean change must
    be 5.6 times its standard error, with three 14 times. Remnant biases estimates, perhaps
    differently before and after; a change of omega_nm or zeta_nm alone does not count as
    adaptation.

    Λ, which forgets b0 and b1 only, is justified if the subject adapts, the batch a1 and a2 are the
    same at both ends (p > 0.01), their mean paths vary less than 0.6 times as much as those of b0
    and b1 (each relative to the scatter of runs), and Λ simulates other runs as well as λ (within
    0.5 VAF points).
    """

    paths: pd.DataFrame
    batch: pd.DataFrame
    scores: pd.DataFrame
    validation: pd.DataFrame
    changes: pd.DataFrame
    delays: pd.DataFrame
    verdicts: pd.DataFrame
    notes: list[str]
    dt: float
    memory_horizon: float
    region: float
    transition_times: dict[Any, float]

    def __repr__(self) -> str:
        n_subjects, n_conditions = self.delays[SUBJECT].nunique(), self.delays[CONDITION].nunique()
        return f"ExperimentResult({n_subjects} subjects, {n_conditions} conditions)"

    @property
    def subjects(self) -> list[Any]:
        """Subjects in the order of the data."""
        return list(dict.fromkeys(self.delays[SUBJECT]))

    @property
    def conditions(self) -> list[Any]:
        """Conditions in the order of the data, sorted where their names can be."""
        found = list(dict.fromkeys(self.delays[CONDITION]))
        return sorted(found) if all(isinstance(name, str) for name in found) else found

    def score_table(self, condition: Any = None) -> pd.DataFrame:
        """Mean scores over the runs of a condition, or of all, as in Table VI.

        One row per subject; columns are pairs of score (``rms_e``, ``tracking_score``,
        ``control_activity``) and window.
        """
        table = self.scores
        if condition is not None:
            table = table[table[CONDITION] == condition]
        mean = table.pivot_table(
            index=SUBJECT, columns="window", values=list(SCORES), sort=False, dropna=False
        )
        windows = list(dict.fromkeys(table["window"]))
        subjects = [subject for subject in self.subjects if subject in mean.index]
        return mean.loc[subjects, [(s, w) for s in SCORES for w in windows]]

    def document(self) -> Document:
        """Scores, who adapts, and whether Λ is justified."""
        runs = self.scores.groupby([SUBJECT, CONDITION])[RUN].nunique()
        window = self.scores[self.scores["window"] == "T_m"]
        title = (
            f"{counted(len(self.subjects), 'subject')}, "
            f"{counted(len(self.conditions), 'condition')}; "
            f"{runs_of_each(runs)}, from {window['start'].min():g} to "
            f"{window['stop'].max():g} s at {1 / self.dt:g} Hz."
        )
        low, high = self.delays["delay"].min(), self.delays["delay"].max()
        delay = f"{low:g}" if np.isclose(low, high) else f"{low:g} to {high:g}"
        horizon = f"{self.memory_horizon:g} samples, {self.memory_horizon * self.dt:g} s"
        adapts, needs = (
            Items([Item(tell(self, c)) for c in self.conditions], numbered=False)
            for tell in (_who_adapts, _who_needs)
        )
        blocks: list[Block] = [
            Paragraph(f"Delay {delay} s; memory horizon {horizon}."),
            *_tell_scores(self),
            Heading(
                "Who adapts (gains in the last compared with the first "
                f"{self.region:g} s, paired over runs; by chance in 1 % of cases)"
            ),
            adapts,
        ]
        several = self.changes["n_runs"][self.changes["n_runs"] > 1]
        if several.min() < ENOUGH:  # NaN where all have a single run
            n = int(several.min())
            factor = stats.t.isf(SIGNIFICANT / 2, n - 1)
            text = (
                f"with {n}, a mean change counts only above {factor:.0f} times its standard error"
            )
            blocks.append(Paragraph(f"Few runs tell little: {text}."))
        blocks += [
            Heading("Is Λ justified, which forgets b0 and b1 only?"),
            needs,
            Notes([Note("", note) for note in self.notes]),
        ]
        return Document(title, blocks)

    def plot(
        self,
        condition: Any = None,
        form: str = "lambda",
        parameters: str = "arx",
        *,
        ax: Any = None,
    ) -> Any:
        """Draw the parameters over time, one column per subject (Figs. 16, 17, M.1-M.6).

        Parameters
        ----------
        condition : label or None, default=None
            Condition; None means the only one.
        form : {"lambda", "Lambda"}, default="lambda"
            Which parameters are forgotten: all (λ), or b0 and b1 only (Λ).
        parameters : {"arx", "operator"}, default="arx"
            a1, a2, b0, b1, or K_e, T_L, K_edot, omega_nm, zeta_nm.
        ax : sequence of Axes or None, default=None
            One for each parameter and subject, row by row. None makes a figure.

        Returns
        -------
        display : EnsembleDisplay
        """
        from ...plotting import EnsembleDisplay

        return EnsembleDisplay.from_result(self, condition, form=form, parameters=parameters, ax=ax)


def verdicts(changes: pd.DataFrame, validation: pd.DataFrame) -> pd.DataFrame:
    """Who adapts, and where Lambda is justified."""
    window = "tran" if (validation["window"] == "tran").any() else "T_m"
    vaf = validation[validation["window"] == window].pivot_table(
        index=[SUBJECT, CONDITION],
        columns="form",
        values="vaf_validation",
        sort=False,
        dropna=False,
    )
    rows = []
    for key, table in changes.groupby([SUBJECT, CONDITION], sort=False):
        of = table.set_index("parameter")
        gains = ["K_e", "K_edot"] if of.loc["K_edot", "n_runs"] > 1 else ["b0", "b1"]
        known = bool((of.loc[gains, "n_runs"] > 1).all())
        changed = [name for name in gains if of.loc[name, "p"] < SIGNIFICANT]
        a, b = (of.loc[names, "variation"].max() for names in (["a1", "a2"], ["b0", "b1"]))
        gain = vaf.loc[key, "Lambda"] - vaf.loc[key, "lambda"]
        p = of.loc[["a1", "a2"], "p"].min()
        against = []
        if p < UNCHANGED:
            against.append(f"a1 or a2 differs in the last region, p = {p:.2g}")
        if not a < STILL * b:
            against.append("a1 and a2 are not constant")
        if gain < -WORSE:
            against.append("other runs are simulated worse")
        if not known:
            verdict = "unknown"
        elif not changed:
            verdict = "no need"
        else:
            verdict = "not justified" if against else "justified"
        rows.append(
            {
                SUBJECT: key[0],
                CONDITION: key[1],
                "adapts": bool(changed) if known else None,
                "gains": tuple(changed),
                "variation_a": a,
                "variation_b": b,
                "gain_lambda": vaf.loc[key, "lambda"] - vaf.loc[key, "constant"],
                "gain_Lambda": gain,
                "Lambda": verdict,
                "reason": "; ".join(against) if verdict == "not justified" else "",
            }
        )
    return pd.DataFrame(rows)


def _tell_scores(r: ExperimentResult) -> list[Block]:
    table = r.score_table().xs("T_m", axis=1, level=1).dropna(axis=1, how="all")
    caption = f"Tracking scores (means over runs{' and conditions' * (len(r.conditions) > 1)})"
    rows = [
        [str(name), *(f"{value:.3f}" for value in row)]
        for name, *row in table.itertuples(name=None)
    ]
    blocks: list[Block] = [TextTable(caption, ("", *table.columns), rows)]
    said = [
        f"highest {what} {table[score].idxmax()}, lowest {table[score].idxmin()}"
        for score, what in (("rms_e", "error"), ("control_activity", "control activity"))
        if score in table and len(table) > 1
    ]
    return [*blocks, Paragraph(as_sentence("; ".join(said)))] if said else blocks


def _who_adapts(r: ExperimentResult, condition: Any) -> str:
    here = r.verdicts[r.verdicts[CONDITION] == condition].to_dict("records")
    parts = []
    for row in here:
        if row["adapts"]:
            found = [_change(r, row, name) for name in row["gains"]]
            parts.append(f"{_person(row)} adapts ({', '.join(found)})")
    still = [_person(row) for row in here if row["adapts"] is False]
    if still:
        verb = "show" if len(still) > 1 else "shows"
        parts.append(f"{listed(still)} {verb} no change beyond the scatter of runs")
    single = [_person(row) for row in here if row["adapts"] is None]
    if single:
        verb = "have" if len(single) > 1 else "has"
        parts.append(f"{listed(single)} {verb} a single run, which is not enough to tell")
    return _said(condition, parts)


def _person(row: dict[str, Any]) -> str:
    return "the operator" if row[SUBJECT] == ALL else str(row[SUBJECT])


def _said(condition: Any, parts: list[str]) -> str:
    """The text on a condition."""
    text = "; ".join(parts) + "."
    return text[0].upper() + text[1:] if condition == ALL else f"{condition}: {text}"


def _change(r: ExperimentResult, row: dict[str, Any], name: str) -> str:
    c = r.changes
    found = c[
        (c[SUBJECT] == row[SUBJECT]) & (c[CONDITION] == row[CONDITION]) & (c["parameter"] == name)
    ].iloc[0]
    unit = " s" if name == "K_edot" else ""
    return (
        f"{name} {found['ini']:.3f} to {found['fin']:.3f}{unit}, "
        f"{100 * found['change'] / abs(found['ini']):+.0f} %"
    )


def _who_needs(r: ExperimentResult, condition: Any) -> str:
    here = r.verdicts[r.verdicts[CONDITION] == condition].to_dict("records")
    parts = []
    for row in here:
        if row["Lambda"] == "justified":
            parts.append(
                f"yes for {_person(row)} (mean paths of a vary {row['variation_a']:.1f}, of b "
                f"{row['variation_b']:.1f} times as much as scatter explains; "
                f"{row['gain_Lambda']:+.1f} VAF points on other runs)"
            )
        elif row["Lambda"] == "not justified":
            parts.append(f"no for {_person(row)} ({row['reason']})")
    for verdict, what in (("no need", "no need for"), ("unknown", "unknown for")):
        names = [_person(row) for row in here if row["Lambda"] == verdict]
        if names:
            parts.append(f"{what} {listed(names)}")
    return _said(condition, parts)
