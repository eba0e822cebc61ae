"""What a mixed model found, as tables and as text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ....text import Summary, counted, number, p_text, wrapped
from ._kenward_roger import FTest


@dataclass(frozen=True, eq=False, repr=False)
class MixedModelResult:
    """What :func:`mixed_model` found.

    Parameters
    ----------
    parameter : str
        The parameter.
    unit : str
        Its unit, or nothing.
    transform : {None, "log"}
        Scale of the model.
    confidence : float
        Of the intervals.
    adjust : str
        How p-values pay for their number.
    reference : label or None
        Condition against which the others were compared; None for all pairs.
    effects : DataFrame
        ``condition``, ``mean`` (over people; geometric with "log"), ``se``, ``df``, ``low``,
        ``high``, ``n_rows``.
    contrasts : DataFrame
        ``condition``, ``against``, ``difference``, ``se``, ``df``, ``t``, ``p``, ``p_adjusted``,
        ``low``, ``high``, and ``d``, ``d_low``, ``d_high``: the difference divided by the standard
        deviation of people. With "log", differences are those of logarithms, and ``ratio``,
        ``ratio_low`` and ``ratio_high`` say them as ratios. Intervals are not adjusted.
    omnibus : FTest or None
        ``F``, ``df1``, ``df2`` and ``p`` of no difference at all; None with one condition.
    variances : DataFrame
        ``source`` (between people; within: people in a condition, of weight 1), ``variance``,
        ``se``, ``sd`` and ``share``.
    people : DataFrame
        ``subject``, ``condition``, ``estimate`` (BLUP: drawn towards the mean as far as its runs
        are few or uncertain), ``low``, ``high``, ``n_rows``.
    checks : DataFrame
        ``check``, ``statistic``, ``p``, ``ok`` (None where it could not be made), ``said``.
    influence : DataFrame
        Contrasts ``without`` each person, their ``shift`` in standard errors, and whether a
        conclusion ``changes``.
    notes : list of str
        What was left out, and how what is missing was handled.
    data : DataFrame
        All rows of the parameter, with ``value`` and ``value_se`` on the scale of the model,
        ``weight`` (the run's share of its person and condition), ``cell_weight`` (that of the
        person and condition, with the mean 1) and ``left_out``: the reason, or nothing.
    tau : float
        Standard deviation between runs beyond their standard errors.
    tau_cells : float
        That of people in a condition beyond the standard errors of their means.
    criterion : float
        -2 log of the restricted likelihood.

    See Also
    --------
    skhoid.lab.experiment.mixed_model : Makes it.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabbccdd"),
    ...         "condition": ["C1", "C2"] * 4,
    ...         "run": 1,
    ...         "unit": "s",
    ...         "parameter": "tau_e",
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...         "se": 0.01,
    ...         "outlying": "",
    ...         "failure": "",
    ...     }
    ... )
    >>> result = mixed_model(table, "tau_e")
    >>> result
    MixedModelResult('tau_e', 4 people, 2 conditions, 8 rows)
    >>> result.effects[["condition", "mean", "low", "high"]].round(3)
      condition   mean    low   high
    0        C1  0.217  0.177  0.258
    1        C2  0.252  0.212  0.293
    """

    parameter: str
    unit: str
    transform: str | None
    confidence: float
    adjust: str
    reference: Any
    effects: pd.DataFrame
    contrasts: pd.DataFrame
    omnibus: FTest | None
    variances: pd.DataFrame
    people: pd.DataFrame
    checks: pd.DataFrame
    influence: pd.DataFrame
    notes: list[str]
    data: pd.DataFrame
    tau: float
    tau_cells: float
    criterion: float

    def __repr__(self) -> str:
        used = int((self.data["left_out"] == "").sum())
        return (
            f"MixedModelResult({self.parameter!r}, {self.people['subject'].nunique()} people, "
            f"{len(self.effects)} conditions, {used} rows)"
        )

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()

    def summary(self) -> Summary:
        """The result in plain words.

        Returns
        -------
        text : Summary
            A string that notebooks show line by line.
        """
        return Summary("\n".join(_summary(self)))


def _summary(r: MixedModelResult) -> list[str]:
    unit = f" {r.unit}" if r.unit else ""
    used = int((r.data["left_out"] == "").sum())
    percent = f"{100 * r.confidence:g} %"
    kind = "geometric means" if r.transform == "log" else "means"
    lines = wrapped(
        f"{r.parameter}: linear mixed model (REML) of {used} rows, "
        f"{r.people['subject'].nunique()} people, {counted(len(r.effects), 'condition')}."
    )
    lines += ["", f"{kind.capitalize()} over people, with {percent} intervals"]
    for row in r.effects.to_dict("records"):
        low, high = (number(row[name], row["se"]) for name in ("low", "high"))
        mean = number(row["mean"], row["se"])
        lines.append(f"  {row['condition']}: {mean}{unit} ({low} to {high})")
    if r.omnibus is not None:
        level = 1.0 - r.confidence
        verdict = "differ" if r.omnibus.p < level else "do not differ beyond chance"
        lines += [
            "",
            f"The conditions {verdict}: F({r.omnibus.df1:.0f}, {r.omnibus.df2:.1f}) = "
            f"{r.omnibus.F:.2f}, {p_text(r.omnibus.p)}.",
            f"Contrasts (p adjusted: {r.adjust}; intervals are not)",
            *(_contrast(r, row, unit) for row in r.contrasts.to_dict("records")),
        ]
    lines += ["", "Standard deviations" + (" of the logarithm" if r.transform == "log" else "")]
    unit = "" if r.transform == "log" else unit
    for row in r.variances.to_dict("records"):
        lines.append(f"  {row['source']}: {row['sd']:.4g}{unit}")
    lines += ["", "Checks"]
    for row in r.checks.to_dict("records"):
        mark = {True: "ok", False: "!", None: "-"}[row["ok"]]
        lines += wrapped(f"  {mark:2} {row['said']}", "     ")
    for note in r.notes:
        lines += wrapped(f"Note: {note}.", "  ")
    return lines


def _contrast(r: MixedModelResult, row: dict[str, Any], unit: str) -> str:
    ends = [number(row[name], row["se"]) for name in ("difference", "low", "high")]
    pair, between = f"{row['condition']} - {row['against']}", unit
    if r.transform == "log":
        ends = [f"{row[name]:.3f}" for name in ("ratio", "ratio_low", "ratio_high")]
        pair, between = f"{row['condition']} / {row['against']}", ""
    size = f", d = {row['d']:.2f}" if np.isfinite(row["d"]) else ""
    star = " *" if row["p_adjusted"] < 1.0 - r.confidence else ""
    return (
        f"  {pair}: {ends[0]}{between} ({ends[1]} to {ends[2]}), t({row['df']:.1f}) = "
        f"{row['t']:.2f}, {p_text(row['p_adjusted'])}{size}{star}"
    )
