"""mixed_model: a parameter of several people over conditions, by a linear mixed model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

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
    counted,
    number,
    p_text,
)
from .factors import find_answers, list_pairs, list_steps, read_factors
from .reml import FTest, MixedFit, fit_reml
from .rows import Cells, Rows, select, weigh

ALPHA = 0.05  # of conclusions, assumptions that are doubted, and intervals
BETWEEN = "between people"
FEW = 6  # people, below which little is known of people in general
MOST = 5000  # rows for which the p-value of Shapiro and Wilk is right


class Contrasts(NamedTuple):
    """Differences of pairs of conditions (positions), with their t tests."""

    pairs: list[tuple[int, int]]
    difference: np.ndarray
    se: np.ndarray
    df: np.ndarray

    @property
    def p(self) -> np.ndarray:
        return 2.0 * stats.t.sf(abs(self.difference / self.se), self.df)


@dataclass(frozen=True)
class Fitted:
    """A fitted model, and its tests."""

    cells: Cells
    at: MixedFit

    @property
    def has_people(self) -> bool:
        """Whether people are a random effect: where some have several conditions."""
        return len(self.at.variances) > 1

    @property
    def between(self) -> float:
        """Variance between people; 0 where the model has none."""
        return float(self.at.variances[0]) if self.has_people else 0.0

    def residuals(self) -> np.ndarray:
        """What the fixed and the random effects leave, in standard deviations of the cell."""
        rest = self.cells.value - self.at.beta[self.cells.condition]
        if self.has_people:
            rest = rest - self.at.effects[self.cells.subject]
        return rest * np.sqrt(self.cells.weight / self.at.variances[-1])

    def omnibus(self) -> FTest | None:
        """All conditions are the same."""
        n = self.cells.n_conditions
        return self.at.test(np.eye(n)[1:] - np.eye(n)[:1]) if n > 1 else None

    def contrasts(self, pairs: list[tuple[int, int]]) -> Contrasts:
        """Differences of some pairs of conditions."""
        n = self.cells.n_conditions
        L = np.array([np.eye(n)[i] - np.eye(n)[j] for i, j in pairs]).reshape(-1, n)
        return Contrasts(pairs, *self.at.estimate(L))


def fit_cells(cells: Cells) -> Fitted:
    """Fit the model by REML."""
    several = cells.value.size > int(cells.subject.max()) + 1
    design = np.eye(cells.n_conditions)[cells.condition]
    people = cells.subject if several else None
    return Fitted(cells, fit_reml(cells.value, design, people, cells.weight))


def holm(p: np.ndarray) -> np.ndarray:
    """p-values that pay for their number."""
    order = np.argsort(p)
    steps = np.maximum.accumulate((p.size - np.arange(p.size)) * p[order])
    adjusted = np.empty(p.size)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


class Check(NamedTuple):
    """One check. ``ok`` is None where it could not be made."""

    check: str
    statistic: float
    p: float
    ok: bool | None
    said: str


def _not_made(check: str, why: str) -> Check:
    return Check(check, np.nan, np.nan, None, why)


def _check_normal(check: str, values: np.ndarray, what: str) -> Check:
    if values.size < 3 or np.ptp(values) <= 1e-12 * max(1.0, np.abs(values).max()):
        return _not_made(check, f"too few {what}, or they do not vary")
    w, p = stats.shapiro(values[:MOST])
    ok = bool(p >= ALPHA)
    said = "look normal" if ok else "are not normal: look for outlying ones, or try another scale"
    return Check(check, float(w), float(p), ok, f"the {what} {said} (Shapiro-Wilk, {p_text(p)})")


def _check_equal_variances(model: Fitted) -> Check:
    rest = model.residuals()
    groups = [rest[model.cells.condition == c] for c in range(model.cells.n_conditions)]
    if len(groups) < 2 or min(map(len, groups)) < 3:
        return _not_made("equal variances", "there are too few conditions, or people in one")
    f, p = stats.levene(*groups, center="median")
    ok = bool(p >= ALPHA)
    said = "scatter alike in all conditions" if ok else "do not scatter alike in all conditions"
    said = f"people {said} (Brown-Forsythe, {p_text(p)})"
    return Check("equal variances", float(f), float(p), ok, said)


def _check_errors(rows: Rows, tau: float) -> Check:
    """The scatter of runs around the mean of their cell, relative to their standard errors."""
    used = rows.used
    cell = used.groupby(["subject", "condition"], sort=False).ngroup().to_numpy()
    df = len(used) - int(cell.max()) - 1
    values, errors = (used[name].to_numpy(dtype=float) for name in ("value", "value_se"))
    if df < 2 or not np.isfinite(errors).all():
        why = "too few runs, or standard errors, to compare"
        return _not_made("standard errors", why)
    w = 1.0 / errors**2
    means = np.bincount(cell, w * values) / np.bincount(cell, w)
    q = float(w @ (values - means[cell]) ** 2)
    low, high = (float(np.sqrt(q / stats.chi2.isf(tail, df))) for tail in (0.025, 0.975))
    ratio = float(np.sqrt(q / df))
    p = float(2.0 * min(stats.chi2.sf(q, df), stats.chi2.cdf(q, df)))
    said = f"runs scatter {ratio:.2f} times ({low:.2f} to {high:.2f}) as much as their se say"
    if low > 1.0:
        said += f"; the weights allow for a further sd of {tau:.3g} between runs"
    return Check("standard errors", ratio, p, bool(low <= 1.0 <= high), said)


def _leave_out_each(
    model: Fitted, pairs: list[tuple[int, int]], rows: Rows
) -> tuple[pd.DataFrame, Check]:
    """The contrasts without each person, and who changes a conclusion (p across the level)."""
    cells, names = model.cells, rows.conditions
    whole = model.contrasts(pairs)
    before = holm(whole.p) < ALPHA
    records: list[dict[str, Any]] = []
    for place, subject in enumerate(rows.subjects if len(names) > 1 else []):
        kept = cells.subject != place
        some = Cells(*(column[kept] for column in cells))
        left, renumbered = np.unique(some.subject, return_inverse=True)
        if len(left) < 2 or np.unique(some.condition).size < len(names):
            continue
        found = fit_cells(some._replace(subject=renumbered)).contrasts(pairs)
        p_adjusted = holm(found.p)
        records += [
            {
                "without": subject,
                "condition": names[i],
                "against": names[j],
                "difference": found.difference[k],
                "shift": (found.difference[k] - whole.difference[k]) / whole.se[k],
                "p_adjusted": p_adjusted[k],
                "changes": bool((p_adjusted[k] < ALPHA) != before[k]),
            }
            for k, (i, j) in enumerate(pairs)
        ]
    if not records:
        return pd.DataFrame(), _not_made("influence", "nobody can be left out")
    table = pd.DataFrame(records)
    largest = table.loc[table["shift"].abs().idxmax()]
    shift = float(abs(largest["shift"]))
    changing = table[table["changes"]]
    said = "; ".join(
        f"without {subject}, conclusions change on "
        + ", ".join(f"{r['condition']} - {r['against']}" for r in of_one.to_dict("records"))
        for subject, of_one in changing.groupby("without", sort=False)
    )
    if changing.empty:
        said = (
            f"no single person changes a conclusion; the largest shift is {shift:.1f} se, without "
            f"{largest['without']}"
        )
    return table, Check("influence", shift, np.nan, changing.empty, said)


def mixed_model(
    table: pd.DataFrame,
    parameter: str,
    *,
    reference: Any = None,
    factors: Mapping[str, Mapping[Any, Any]] | Sequence[str] | None = None,
    transform: str | None = None,
    outlying: str = "keep",
) -> MixedModelResult:
    """Compare the conditions of an experiment by a weighted linear mixed model.

    The second of two stages: the first identified each run, and gave an estimate with its standard
    error.

    Parameters
    ----------
    table : DataFrame
        Tidy table of parameters, one row for each fit and parameter, with the columns subject,
        condition, run, parameter, estimate, se, unit, outlying and failure.
    parameter : str
        Which parameter.
    reference : label or None, default=None
        Condition against which the others are compared; None compares all pairs.
    factors : dict, sequence of str or None, default=None
        What the conditions are combinations of: ``{"pace": {"fast_rested": "fast", ...}, "state":
        {"fast_rested": "rested", ...}}``, or columns of the table, ``["pace", "state"]``. None
        finds them in the names of conditions, where all combinations are there (fast_rested,
        fast_tired, slow_rested, slow_tired); ``()`` means none.
    transform : {None, "log"}, default=None
        Scale of the model. With "log", means are geometric and contrasts are ratios too.
    outlying : {"keep", "leave_out"}, default="keep"
        What becomes of rows that the table calls outlying.

    Returns
    -------
    result : MixedModelResult
        Tables of means, contrasts, variances, people and checks; ``summary()`` says them in words.

    Raises
    ------
    ValueError
        If there is no such parameter, condition or option; if there is one person only; if no row
        can be used; if "log" meets an estimate that is not above 0.

    Notes
    -----
    First the runs r of person p in condition c become one value, with weights that count precise
    runs more; then conditions are compared over people:

        y_pc = Σ_r w_pcr y_pcr / Σ_r w_pcr,  w_pcr = 1 / (se_pcr² + τ²),  s_pc² = 1 / Σ_r w_pcr
        y_pc = β_c + b_p + ε_pc,  Var(ε_pc) = σ² / W_pc,  W_pc ∝ 1 / (s_pc² + τ_c²)

    with random b. It equals ``lmer(value ~ condition + (1 | subject), weights = cell_weight)``.
    τ² is the variance between runs beyond their standard errors, τ_c² that of people in a condition
    beyond s² around subject + condition, both as Paule and Mandel estimate them [1]_, the latter
    one standard deviation large. Variances are those of the restricted likelihood (REML); standard
    errors, degrees of freedom and the F test are those of Kenward and Roger [2]_. Intervals are
    95 %, and p-values of contrasts pay for their number by Holm. Rows without a standard error get
    the largest one of their person and condition; where no row has one, all count alike.

    A factor is tested by each person's own difference between two of its levels, the mean over the
    levels of the other, and an interaction by the difference of these differences: people need not
    answer alike, as with a random slope. Their mean over people is weighted by 1 / (s² + τ²), its
    standard error that of Hartung and Knapp [3]_, with a degree of freedom less than people.

    References
    ----------
    .. [1] R. C. Paule and J. Mandel, "Consensus values and weighting factors", J. Res. Natl. Bur.
       Stand. 87 (1982) 377-385.
    .. [2] M. G. Kenward and J. H. Roger, "Small sample inference for fixed effects from restricted
       maximum likelihood", Biometrics 53 (1997) 983-997.
    .. [3] J. Hartung and G. Knapp, "A refined method for the meta-analysis of controlled clinical
       trials with binary outcome", Stat. Med. 20 (2001) 3875-3889.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
    >>> rng = np.random.default_rng(0)
    >>> person = {f"S{p}": rng.normal(1.0, 0.2) for p in range(8)}
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": s,
    ...         "condition": c,
    ...         "run": r,
    ...         "estimate": k + 0.2 * (c == "C2") + rng.normal(0.0, 0.05),
    ...     }
    ...     for s, k in person.items()
    ...     for c in ("C1", "C2")
    ...     for r in range(4)
    ... ).assign(parameter="K_e", se=0.05, unit="", outlying="", failure="")
    >>> result = mixed_model(table, "K_e")
    >>> result.contrasts[["condition", "against", "difference", "se", "df"]].round(3)
      condition against  difference     se   df
    0        C2      C1       0.189  0.008  7.0
    """
    rows = select(table, parameter, transform=transform, outlying=outlying)
    if len(rows.subjects) < 2:
        raise ValueError(
            f"{parameter} has rows of one person only ({rows.subjects[0]}). A mixed model needs "
            "at least two people, and is of use from about six; compare the runs of one person by "
            "a t test."
        )
    pairs = list_pairs(rows.conditions, reference)
    cells, _, tau, tau_cells = weigh(rows)
    try:
        model = fit_cells(cells)
    except ValueError as error:
        raise ValueError(f"The mixed model of {parameter} cannot be fitted: {error}") from None
    said, lacking = _of_factors(model, rows, factors, reference, transform == "log")
    influence, who_decides = _leave_out_each(model, pairs, rows)
    checks = [_check_normal("normal residuals", model.residuals(), "residuals")]
    if model.has_people:
        checks.append(_check_normal(f"normal {BETWEEN}", model.at.effects, "effects of people"))
    checks += [_check_equal_variances(model), _check_errors(rows, tau), who_decides]
    log = transform == "log"
    return MixedModelResult(
        parameter=parameter,
        unit=rows.unit,
        transform=transform,
        effects=_means(model, rows, log),
        contrasts=_contrasts(model, pairs, rows.conditions, log),
        factors=said,
        omnibus=model.omnibus(),
        variances=_variances(model),
        people=_people(model, rows, log),
        checks=pd.DataFrame(checks),
        influence=influence,
        notes=[*rows.notes, *_notes(model, rows), *lacking],
        data=rows.data,
        tau=tau,
        tau_cells=tau_cells,
        criterion=model.at.criterion,
    )


def _reach(df: np.ndarray, se: np.ndarray) -> np.ndarray:
    """Half of the 95 % interval."""
    return stats.t.isf(ALPHA / 2.0, df) * se


def _means(model: Fitted, rows: Rows, log: bool) -> pd.DataFrame:
    mean, se, df = model.at.estimate(np.eye(len(rows.conditions)))
    low, high = mean - _reach(df, se), mean + _reach(df, se)
    if log:
        mean, low, high = np.exp(mean), np.exp(low), np.exp(high)
        se = se * mean
    n_rows = rows.used["condition"].value_counts()[rows.conditions].to_numpy()
    found = {"condition": rows.conditions, "mean": mean, "se": se, "df": df}
    return pd.DataFrame(found | {"low": low, "high": high, "n_rows": n_rows})


def _contrasts(
    model: Fitted, pairs: list[tuple[int, int]], names: list[Any], log: bool
) -> pd.DataFrame:
    found = model.contrasts(pairs)
    labels = {
        "condition": [names[i] for i, _ in pairs],
        "against": [names[j] for _, j in pairs],
    }
    return _tested(labels, found.difference, found.se, found.df, model, log)


def _tested(
    labels: Mapping[str, list[Any]],
    apart: np.ndarray,
    se: np.ndarray,
    df: np.ndarray,
    model: Fitted,
    log: bool,
) -> pd.DataFrame:
    """A table of differences, with their t tests, intervals and effect sizes."""
    reach, p = _reach(df, se), 2.0 * stats.t.sf(abs(apart / se), df)
    d = d_reach = np.full(apart.size, np.nan)
    if model.between > 0.0:  # relative to the standard deviation of people, by the delta method
        d = apart / np.sqrt(model.between)
        own = float(model.at.variance_covariance[0, 0]) / (4.0 * model.between**2)
        d_reach = _reach(df, np.sqrt(se**2 / model.between + d**2 * own))
    numbers: dict[str, Any] = {"difference": apart, "se": se, "df": df, "t": apart / se, "p": p}
    numbers |= {"p_adjusted": holm(p), "low": apart - reach, "high": apart + reach}
    numbers |= {"d": d, "d_low": d - d_reach, "d_high": d + d_reach}
    if log:
        ends = {"": "difference", "_low": "low", "_high": "high"}
        numbers |= {f"ratio{end}": np.exp(numbers[name]) for end, name in ends.items()}
    return pd.DataFrame({**labels, **numbers})


def _of_factors(
    model: Fitted, rows: Rows, factors: Any, reference: Any, log: bool
) -> tuple[pd.DataFrame, list[str]]:
    """Differences between levels of each factor, and of these between levels of another."""
    steps = list_steps(read_factors(rows, factors), reference)
    if not steps:
        return pd.DataFrame(), []
    tested, lacking = zip(*(find_answers(model.cells, step.weights) for step in steps), strict=True)
    names = sorted({str(rows.subjects[who]) for some in lacking for who in some})
    notes = [f"factors are without {', '.join(names)}, who lack a condition"] * bool(names)
    labels = {
        "factor": [step.factor for step in steps],
        "level": [step.level for step in steps],
        "against": [step.against for step in steps],
    }
    apart, se, df = np.array(tested).T
    return _tested(labels, apart, se, df, model, log), notes


def _variances(model: Fitted) -> pd.DataFrame:
    variance = model.at.variances
    return pd.DataFrame(
        {
            "source": [*[BETWEEN] * model.has_people, "within"],
            "variance": variance,
            "se": np.sqrt(np.maximum(np.diag(model.at.variance_covariance), 0.0)),
            "sd": np.sqrt(variance),
            "share": variance / variance.sum(),
        }
    )


def _people(model: Fitted, rows: Rows, log: bool) -> pd.DataFrame:
    """Each person in each condition (BLUP), also where there are no runs."""
    at = model.at
    df = at.estimate(np.eye(len(rows.conditions)))[2]
    n_runs = rows.used.groupby(["subject", "condition"]).size()
    records = []
    for p, subject in enumerate(rows.subjects):
        for c, condition in enumerate(rows.conditions):
            variance, value = at.plain[c, c], at.beta[c]
            if model.has_people:
                variance += 2.0 * at.cross_covariance[c, p] + at.effect_covariance[p, p]
                value += at.effects[p]
            ends = value + _reach(df[c], np.sqrt(variance)) * np.array([0.0, -1.0, 1.0])
            ends = np.exp(ends) if log else ends
            records.append((subject, condition, *ends, int(n_runs.get((subject, condition), 0))))
    names = ["subject", "condition", "estimate", "low", "high", "n_rows"]
    return pd.DataFrame(records, columns=names)


def _notes(model: Fitted, rows: Rows) -> list[str]:
    notes = []
    there = set(zip(rows.used["subject"], rows.used["condition"], strict=True))
    empty = [
        f"{subject} in {condition}"
        for subject in rows.subjects
        for condition in rows.conditions
        if (subject, condition) not in there
    ]
    if empty:
        notes.append(f"no rows of {', '.join(empty)}: the others of the person still count")
    if model.has_people and model.between <= 0.0:
        notes.append(f"the variance {BETWEEN} is estimated as 0, its lower bound")
    if len(rows.subjects) < FEW:
        notes.append(f"{len(rows.subjects)} people tell little about people in general")
    if len(rows.conditions) > 1 and model.has_people:
        sd = float(np.sqrt(model.between))
        notes.append(f"d is the difference divided by the sd of people, {sd:.4g} ({BETWEEN})")
    return notes


@dataclass(frozen=True, eq=False, repr=False)
class MixedModelResult(Told):
    """What :func:`mixed_model` found.

    Parameters
    ----------
    parameter : str
        The parameter.
    unit : str
        Its unit, or nothing.
    transform : {None, "log"}
        Scale of the model.
    effects : DataFrame
        ``condition``, ``mean`` (over people; geometric with "log"), ``se``, ``df``, ``low``,
        ``high``, ``n_rows``.
    contrasts : DataFrame
        ``condition``, ``against``, ``difference``, ``se``, ``df``, ``t``, ``p``, ``p_adjusted``
        (Holm), ``low``, ``high``, and ``d``, ``d_low``, ``d_high``: the difference divided by the
        standard deviation of people. With "log", differences are those of logarithms, and
        ``ratio``, ``ratio_low`` and ``ratio_high`` say them as ratios. Intervals are not adjusted.
    factors : DataFrame
        The same columns for the factors that the conditions are combinations of: ``factor``,
        ``level`` and ``against``, then interactions, ``fast/slow x rested/tired``. Empty if there
        are none.
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
    """

    parameter: str
    unit: str
    transform: str | None
    effects: pd.DataFrame
    contrasts: pd.DataFrame
    factors: pd.DataFrame
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
        return (
            f"MixedModelResult({self.parameter!r}, {self.people['subject'].nunique()} people, "
            f"{len(self.effects)} conditions, {self.effects['n_rows'].sum()} rows)"
        )

    @property
    def own_means(self) -> pd.DataFrame:
        """Weighted means of the runs of each person, with intervals; not drawn to the group."""
        used = self.data[self.data["left_out"] == ""]
        reach = stats.norm.isf(ALPHA / 2.0) * self.variances["sd"].iloc[-1]
        records = []
        for key, rows in used.groupby(["subject", "condition"], sort=False):
            mean = float(rows["weight"] @ rows["value"])
            away = reach / np.sqrt(rows["cell_weight"].iloc[0])
            ends = np.array([mean, mean - away, mean + away])
            ends = np.exp(ends) if self.transform == "log" else ends
            records.append((*key, *ends, len(rows)))
        return pd.DataFrame(records, columns=list(self.people.columns))

    @property
    def verdict(self) -> str:
        """Whether the conditions differ, with the F test; nothing with one condition."""
        if self.omnibus is None:
            return ""
        F, df1, df2, p = self.omnibus
        verdict = "differ" if p < ALPHA else "do not differ beyond chance"
        return f"The conditions {verdict}: F({df1:.0f}, {df2:.1f}) = {F:.2f}, {p_text(p)}."

    def document(self) -> Document:
        """The result in plain words."""
        title = (
            f"{self.parameter}: linear mixed model (REML) of {self.effects['n_rows'].sum()} rows, "
            f"{self.people['subject'].nunique()} people, "
            f"{counted(len(self.effects), 'condition')}."
        )
        log = self.transform == "log"
        unit = f", {self.unit}" if self.unit else ""
        means = f"{'Geometric means' if log else 'Means'} over people{unit}, with 95 % intervals"
        blocks: list[Block] = [
            TextTable(
                means,
                ("", "mean", "from", "to", "rows"),
                [
                    [str(row["condition"]), *_ends(row, "mean"), str(row["n_rows"])]
                    for row in self.effects.to_dict("records")
                ],
            )
        ]
        if self.verdict:
            blocks.append(Paragraph(self.verdict))
            if len(self.factors):
                blocks.append(self._tell_contrasts(self.factors, "factors"))
            blocks.append(self._tell_contrasts(self.contrasts, "conditions"))
        sds = [[row["source"], f"{row['sd']:.4g}"] for row in self.variances.to_dict("records")]
        marks = {True: "ok", False: "doubtful", None: "not known"}
        checks = [f"{marks[row['ok']]}: {row['said']}" for row in self.checks.to_dict("records")]
        blocks += [
            TextTable(
                f"Standard deviations{' of the logarithm' if log else unit}", ("", "sd"), sds
            ),
            Heading("Checks"),
            Items([Item(text) for text in checks], numbered=False),
            Notes([Note("", text) for text in self.notes]),
        ]
        return Document(title, blocks)

    def _tell_contrasts(self, table: pd.DataFrame, what_of: str) -> TextTable:
        log = self.transform == "log"
        rows = []
        for row in table.to_dict("records"):
            if log:
                ends = [f"{row[f'ratio{end}']:.3f}" for end in ("", "_low", "_high")]
            else:
                ends = _ends(row, "difference")
            pair = (
                f"{row.get('condition', row.get('level'))} {'/' if log else '-'} {row['against']}"
            )
            test = f"t({row['df']:.1f}) = {row['t']:.2f}"
            p = p_text(row["p_adjusted"]) + " *" * (row["p_adjusted"] < ALPHA)
            rows.append([pair, *ends, test, p, f"{row['d']:.2f}" if np.isfinite(row["d"]) else "-"])
        what = "Ratios" if log else f"Differences{f', {self.unit}' if self.unit else ''}"
        caption = f"{what} of {what_of} (p adjusted: Holm; intervals are not)"
        header = ("", "ratios" if log else "differences", "from", "to", "", "p", "d")
        return TextTable(caption, header, rows)


def _ends(row: dict[str, Any], name: str) -> list[str]:
    """A number and the ends of its interval, as exact as its standard error allows."""
    return [number(row[key], row["se"]) for key in (name, "low", "high")]


def tell_changes(results: Iterable[MixedModelResult], names: Mapping[str, str]) -> list[str]:
    """What conditions change beyond chance, the surest first, a sentence for each pair.

    p-values pay for the contrasts of all parameters together (Holm). Factors come in place of pairs
    of conditions. ``names`` has what parameters are called.
    """
    tables = [
        (result.factors if len(result.factors) else result.contrasts).assign(
            of=names.get(result.parameter, result.parameter), unit=result.unit
        )
        for result in results
        if len(result.contrasts)
    ]
    if not tables:
        return []
    rows = pd.concat(tables, ignore_index=True)
    rows = rows[np.isfinite(rows["p"])]
    rows = rows[holm(rows["p"].to_numpy(dtype=float)) < ALPHA]
    rows = rows.assign(size=rows["t"].abs()).sort_values("size", ascending=False, kind="stable")
    found: dict[str, list[str]] = {}
    for row in rows.to_dict("records"):
        is_factor = isinstance(row.get("factor"), str)
        level = row["level" if is_factor else "condition"]
        less = "less that" if is_factor and " - " in str(row["level"]) else "against"
        estimate, low, high = _ends(row, "difference")
        sign, unit = "+" * (row["difference"] > 0.0), f" {row['unit']}" if row["unit"] else ""
        found.setdefault(f"{level} {less} {row['against']}", []).append(
            f"{row['of']} {sign}{estimate}{unit} ({low} to {high})"
        )
    return [f"{pair}: {'; '.join(texts)}." for pair, texts in found.items()]
