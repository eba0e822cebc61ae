"""Memory horizons: the study of Fig. 13 and App. J, and the advice for an experiment to come."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ... import CompensatoryTask, forgetting_factor
from ...arx.many_runs import FORMS, HORIZONS, fit_runs, score_horizons, search_delays
from ...simulation import Condition, change_times, operator_response
from ...text import Document, Paragraph
from .blocks import Block
from .declared import CONDITIONS, INTENSITIES, Claim, PaperStudy, range_text
from .monte_carlo import MonteCarloStudy

KEPT = 1.0  # s kept of the run-in, so that shifted signals have a past; more for long delays
FIRST_PART = 30.72  # s: first and last part of a run, in which nothing changes
TRANSITION = (30.72, 51.20)  # s: where validation runs are scored
EARLIER, LATER = 0.13, 0.20  # s below and above tau_e: the range in which n_k / f_s is searched
SETTING = ["form", "memory_horizon"]


def forgetting_vaf(
    block: Block,
    *,
    memory_horizons: Sequence[float] = HORIZONS,
    window: tuple[float, float] = TRANSITION,
    init_window: float = FIRST_PART,
    scaled: bool = False,
    by_run: bool = False,
) -> pd.DataFrame:
    """VAF of recursions by memory horizon, for a :class:`MonteCarloStudy`.

    Each run has its own n_k*, theta0 from its first ``init_window`` seconds and P0 = I; with
    ``scaled`` the signals are first scaled to unit power there, so that P0 weighs as much as one
    sample whatever the units. With ``by_run`` there is a row for each validation run.
    """
    rate = block.task.sampling_rate
    before, first = int((block.record.time < 0).sum()), round(init_window * rate)
    begin, end = (round(instant * rate) for instant in window)
    if block.validation is None:
        raise ValueError("The trade-off is seen on validation runs: n_validation must be above 0.")
    nks = candidate_delays(block.task)
    e, u, e_v, u_v = block.record.e, block.record.u, block.validation.e, block.validation.u
    n_runs = len(e)
    if (e == e[0]).all() and (u == u[0]).all():  # as without remnant
        e, u = e[:1], u[:1]
    losses, _ = search_delays(e, u, before, nks)
    delays = nks[losses.argmin(axis=1)]
    rows = []
    for run, nk in enumerate(delays):
        one, many = (shifted(x, before, nk, extra=1) for x in (e[[run]], e_v))
        u_one, u_many = u[[run], before:], u_v[:, before:]
        if scaled:
            e_power, u_power = (
                np.sqrt(np.mean(signal[:, :first] ** 2)) for signal in (one[:, 1:], u_one)
            )
            one, many, u_one, u_many = (
                one / e_power, many / e_power, u_one / u_power, u_many / u_power,
            )  # fmt: skip
        theta0 = fit_runs(one[:, 1 : first + 1], u_one[:, :first])[0]
        rows.append(
            score_horizons(
                one[0, : end + 1], u_one[0, :end], theta0, many[:, : end + 1], u_many[:, :end],
                memory_horizons, FORMS, (begin, end),
            )
        )  # fmt: skip
    # runs, forms, horizons, recordings
    vaf = np.broadcast_to(np.array(rows), (n_runs, *rows[0].shape))
    of_validation = vaf[..., 1:] if by_run else vaf[..., 1:].mean(axis=-1, keepdims=True)
    shape = of_validation.shape

    def spread(values: Any, axis: int) -> np.ndarray:
        along = np.expand_dims(np.asarray(values), [i for i in range(4) if i != axis])
        return np.broadcast_to(along, shape).ravel()

    table = pd.DataFrame(
        {
            "replication": spread(block.replications, 0),
            "form": spread(np.array(FORMS, dtype=object), 1),
            "memory_horizon": spread(np.array(memory_horizons, dtype=float), 2),
            "nk": spread(np.broadcast_to(delays, n_runs), 0),
            "P_n": spread(block.record.intensity(), 0),
            "vaf_estimation": np.broadcast_to(vaf[..., :1], shape).ravel(),
            "vaf_validation": of_validation.ravel(),
        }
    )
    if by_run:
        table.insert(3, "validation", spread(range(len(e_v)), 3))
    else:
        table["sd_validation"] = (
            vaf[..., 1:].std(axis=-1, ddof=1).ravel() if len(e_v) > 1 else np.nan
        )
    return table


def with_gain(table: pd.DataFrame, data_set: list[str]) -> pd.DataFrame:
    """The gain in VAF over no forgetting (Eqs. 31-32), of the same data set and form."""
    columns = [*data_set, "form"]
    endless = table[np.isinf(table["memory_horizon"])].set_index(columns)["vaf_validation"]
    base = table.join(endless.rename("base"), on=columns)["base"]
    return table.assign(gain=table["vaf_validation"] - base)


def candidate_delays(task: CompensatoryTask) -> np.ndarray:
    """n_k around the operator's delay: from 0.15 to 0.48 s in the conditions of the thesis."""
    delay = operator_response(task).delay_time
    shortest, longest = (round((delay + apart) * task.sampling_rate) for apart in (-EARLIER, LATER))
    return np.arange(max(shortest, 1), longest + 1)


def _kept_run_in(task: CompensatoryTask) -> float:
    """Seconds of the run-in that shifting by any of the candidate delays needs."""
    kept = max(KEPT, operator_response(task).delay_time + 2 * LATER)
    there = task.n_run_in / task.sampling_rate
    if there < kept:
        raise ValueError(
            f"The task has a run-in of {there:g} s; {kept:g} s are needed, because the error "
            "must be known one delay before the measurement window. Use run_in=None, or a longer "
            "run-in."
        )
    return kept


def shifted(e: np.ndarray, before: int, nk: int, extra: int = 0) -> np.ndarray:
    """e(t - n_k) of the window, of shape (n_runs, extra + n_samples), from run-in and window."""
    return e[:, before - nk - extra : e.shape[1] - nk]


CELL = ["condition", "remnant_intensity"]
VARYING = ("C3", "C4", "C5", "C6")
BEST = 256.0  # N0 of the thesis
PRACTICALLY_NONE = 1.0  # VAF points between forgetting by factor and by matrix
LONG = 2048.0  # N0 from which on a memory is long


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means over replications by cell and setting."""
    grouped = with_gain(table, [*CELL, "replication"]).groupby([*CELL, *SETTING])
    names = ["nk", "P_n", "vaf_estimation", "vaf_validation", "sd_validation", "gain"]
    means = grouped[names].mean()
    errors = grouped["gain"].std() / np.sqrt(grouped["gain"].count())
    overfit = means["vaf_estimation"] - means["vaf_validation"]
    return means.assign(se_gain=errors, overfit=overfit)


def _claims(summary: pd.DataFrame, table: pd.DataFrame) -> Iterator[Claim]:
    gain = summary["gain"].unstack("memory_horizon")
    cells = {key[:2] for key in summary.index}
    whole = cells >= {(condition, P_n) for condition in CONDITIONS for P_n in INTENSITIES}
    # With the highest mean VAF on validation runs, by cell and form.
    best = summary["vaf_validation"].unstack("memory_horizon").idxmax(axis=1)
    best = best.reset_index(name="N0")
    overall = gain.groupby("form").mean()
    for form, sign in (("lambda", "λ"), ("Lambda", "Λ")):
        N0 = float(overall.loc[form].idxmax())
        near = "; ".join(
            f"{overall.loc[form, h]:+.2f} at {h:g}" for h in (128.0, 256.0, 512.0) if h in overall
        )
        yield Claim(
            "Fig. 13",
            f"over all conditions and intensities N0 = 256 is the best, {sign}",
            f"N0 = {N0:g} (mean gain {near})",
            N0 == BEST if whole else None,
        )
    if BEST in gain:
        at_best = gain[BEST].unstack("form") + summary["vaf_validation"].unstack("memory_horizon")[
            np.inf
        ].unstack("form")
        apart = (at_best["Lambda"] - at_best["lambda"]).reset_index(name="apart")
        apart = apart.loc[apart["remnant_intensity"] > 0, "apart"]
        if len(apart):
            yield Claim(
                "Fig. 13",
                "no significant difference between λ and Λ",
                f"Λ minus λ at N0 = 256: {range_text(apart, 2, sign=True)} points",
                bool(apart.abs().max() < PRACTICALLY_NONE),
            )
    yield from _claims_of_cells(best, gain)


def _claims_of_cells(best: pd.DataFrame, gain: pd.DataFrame) -> Iterator[Claim]:
    of_lambda = best[best["form"] == "lambda"]
    varying = of_lambda[of_lambda["condition"].isin(VARYING)]
    if len(varying["remnant_intensity"].unique()) > 1:
        octaves = varying.pivot(index="condition", columns="remnant_intensity", values="N0")
        octaves = np.log2(octaves.clip(upper=2.0**14))
        steps = np.diff(octaves.to_numpy(), axis=1)
        yield Claim(
            "Fig. 13",
            "lower intensities require lower N0 (C3-C6)",
            "; ".join(
                f"P_n = {P_n:g}: {range_text(values, 0)}"
                for P_n, values in varying.groupby("remnant_intensity")["N0"]
            ),
            bool((steps >= -1).all() and (octaves.iloc[:, -1] > octaves.iloc[:, 0]).all()),
        )
    constant = of_lambda[of_lambda["condition"].isin(("C1", "C2"))]
    constant = constant[constant["remnant_intensity"] > 0]
    if len(constant):
        yield Claim(
            "Fig. 13",
            "constant dynamics (C1, C2) require longer memories",
            f"best N0 with remnant {range_text(constant['N0'], 0)}",
            bool((constant["N0"] >= LONG).all()),
        )
    gains = gain.max(axis=1).xs("lambda", level="form").unstack("condition")
    gains = gains[gains.index > 0]
    if {"C3", "C4", "C5", "C6"} <= set(gains.columns) and len(gains):
        into, back = gains[["C3", "C4"]].mean(axis=1), gains[["C5", "C6"]].mean(axis=1)
        yield Claim(
            "Fig. 13",
            "forgetting gains notably less in C5 and C6 (1/s² to 1/s) than in C3 and C4",
            f"best mean gains {range_text(back, 1)} against {range_text(into, 1)} points",
            bool((back < into).all()),
        )
    if {"C1", "C2"} <= set(gains.columns) and 16.0 in gain.columns and len(gains) > 1:
        at_16 = gain[16.0].xs("lambda", level="form").unstack("condition")
        at_16 = at_16[at_16.index > 0]
        spread = at_16.max() - at_16.min()
        yield Claim(
            "Fig. 13",
            "the gains of different intensities lie further apart in C2 than in C1",
            f"at N0 = 16 over {spread['C2']:.1f} and {spread['C1']:.1f} points",
            bool(spread["C2"] > spread["C1"]),
        )


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    def draw(kind: str) -> Any:
        from ...plotting import MemoryHorizonDisplay

        return MemoryHorizonDisplay.from_summary(_summary(table), kind=kind)

    kinds = {
        "fig13": "gain",
        "figJ1": "vaf_estimation",
        "figJ2": "vaf_validation",
        "figJ3": "overfit_difference",
        "figJ4": "overfit_ratio",
        "figJ5": "tradeoff_ratio",
    }
    return {name: partial(draw, kind) for name, kind in kinds.items()}


FORGETTING = PaperStudy(
    "memory horizons, λ and Λ",
    "Tracking ability against noise sensitivity, for λ and Λ (Fig. 13, App. J)",
    {
        "conditions": CONDITIONS,
        "intensities": INTENSITIES,
        "memory_horizons": HORIZONS,
        "n_validation": 10,
        "remnant_order": 2,
        "gains": "table",
    },
    forgetting_vaf,
    _summary,
    _claims,
    _figures,
    ("fig13",),
    {"keep_run_in": KEPT},
    {"batched": True, "block_size": 50},
)

FIRST = 3 / 8  # of the duration, in which nothing changes: 30.72 s of 81.92 s
HALF_WIDTH = 1 / 8  # of the duration, on either side of the change
WIDER = 0.75  # times the duration of the change
SHORTEST = 2.0  # s from which theta0 may come
SIGNIFICANT = 2.0  # standard errors
RUNS = ["remnant_intensity", "replication", "validation"]


@dataclass(frozen=True, eq=False, repr=False)
class ForgettingAdvice:
    """The memory horizon that suits an experiment, and the results behind it.

    Parameters
    ----------
    memory_horizon : float
        N0 in samples with the highest mean VAF on validation runs; infinity (no forgetting) if that
        is as good.
    close : list of float
        Horizons whose mean VAF is within two standard errors (paired) of the highest.
    gain : float
        VAF points gained over no forgetting.
    summary : DataFrame
        Mean VAF on estimation and validation runs, gain and its standard error, by intensity, form
        and horizon.
    table : DataFrame
        VAF of each estimation run on each validation run.
    window : tuple of float
        Where validation runs were scored, in s.
    sampling_rate : float
        Sampling rate in Hz.
    """

    memory_horizon: float
    close: list[float]
    gain: float
    summary: pd.DataFrame
    table: pd.DataFrame
    window: tuple[float, float]
    sampling_rate: float

    @property
    def memory_time(self) -> float:
        """The memory horizon in s."""
        return self.memory_horizon / self.sampling_rate

    @property
    def forgetting(self) -> float:
        """The forgetting factor λ = 1 - 1/N0."""
        return float(forgetting_factor(self.memory_horizon))

    def __repr__(self) -> str:
        return str(self.document().text())

    def _repr_html_(self) -> str:
        return self.document().html()

    def document(self) -> Document:
        """What to do, what is as good, and from how many runs."""
        runs = self.table["replication"].nunique()
        intensities = ", ".join(f"{P:.2g}" for P in self.table["remnant_intensity"].unique())
        if np.isinf(self.memory_horizon):
            head = "Do not forget (λ = 1): no memory horizon gives a clearly better VAF."
        else:
            head = (
                f"N0 = {self.memory_horizon:g} samples ({self.memory_time:.3g} s, "
                f"λ = {self.forgetting:.5f}): VAF {self.gain:+.1f} points over no forgetting."
            )
        others = [N0 for N0 in self.close if self.memory_horizon != N0]
        alike = (
            f"Equally good within two standard errors: N0 = "
            f"{', '.join(f'{N0:g}' for N0 in others)}."
            if others
            else "All other horizons of the grid are worse by more than two standard errors."
        )
        best = self.summary["vaf_validation"].groupby(SETTING).mean().groupby("form").max()
        apart = float(best["Lambda"] - best["lambda"])
        texts = [
            alike,
            f"Forgetting only b0 and b1 (Λ), at its best: {apart:+.2f} points.",
            f"From {runs} runs at P_n = {intensities}, {self.sampling_rate:g} Hz, scored from "
            f"{self.window[0]:.4g} to {self.window[1]:.4g} s on runs that were not fitted.",
        ]
        return Document(head, [Paragraph(text) for text in texts])

    def plot(self, kind: str = "gain") -> Any:
        """Draw the trade-off, by kinds of :class:`skhoid.plotting.MemoryHorizonDisplay`."""
        from ...plotting import MemoryHorizonDisplay

        return MemoryHorizonDisplay.from_summary(self.summary, kind=kind)


def recommend_forgetting(
    task: str | Condition | CompensatoryTask,
    remnant_intensity: float | Sequence[float] | None = None,
    *,
    window: tuple[float, float] | None = None,
    n_replications: int = 20,
    n_validation: int = 10,
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> ForgettingAdvice:
    """Find the memory horizon for an experiment, by the study of Fig. 13 on a simulation of it.

    Estimation runs are simulated, recursive ARX[2, 2] models with every memory horizon follow them,
    and each path of parameters is simulated on validation runs. The horizon that does best on those
    is long enough to average out remnant, and short enough to follow the change.

    Parameters
    ----------
    task : str, Condition or CompensatoryTask
        The experiment: controlled element, forcing functions, sampling rate, duration, and the
        expected operator, with all changes over time; or the name of a condition of the thesis.
    remnant_intensity : float, sequence of float or None, default=None
        Expected P_n, or several to average over; None means the task's own remnant.
    window : (float, float) or None, default=None
        Where validation runs are scored, in s. None means around the change: an eighth of the
        duration on either side of its middle, or more if the change takes longer; if nothing
        changes, everything after the first part.
    n_replications : int, default=20
        Estimation runs for each intensity.
    n_validation : int, default=10
        Validation runs.
    random_state : int, RandomState, Generator or None, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    advice : ForgettingAdvice
        ``print(advice)`` shows it as text; ``advice.plot()`` draws VAF by memory horizon.

    Raises
    ------
    ValueError
        If there is no remnant (the shortest memory then always wins), or windows do not fit.
    RemnantIntensityError
        If the loop cannot reach the intensity.

    Notes
    -----
    Horizons are 2, 4, 8 ... up to the samples of a run, and infinity; the remnant is of second
    order unless the task has its own. The first three eighths of a run give theta0, but no further
    than ``window``. Signals are first scaled to unit power, so that P0 = I weighs as much as one
    sample whatever the units.

    References
    ----------
    Van Grootheest, thesis, Sections IV-E and V-B.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from skhoid import CompensatoryTask, recommend_forgetting
    >>> task = CompensatoryTask.of_condition("C3", sampling_rate=50.0)
    >>> advice = recommend_forgetting(task, remnant_intensity=0.15, n_replications=8)
    >>> advice.memory_time, round(advice.forgetting, 4)
    (2.56, 0.9922)
    """
    if not isinstance(task, CompensatoryTask):
        task = CompensatoryTask.of_condition(task)
    rate = task.sampling_rate
    around = _change_window(task) if window is None else (float(window[0]), float(window[1]))
    first = FIRST * task.duration
    if around is not None and SHORTEST <= around[0] < first:
        first = around[0]
    around = (first, task.duration) if around is None else around
    if not 0 <= around[0] < around[1] <= task.duration + 1e-9:
        raise ValueError(
            f"window={around} does not lie in the run of {task.duration:g} s (from 0 s on)."
        )
    horizons = (*(2.0**i for i in range(1, int(np.log2(task.n_samples)) + 1)), np.inf)
    study = MonteCarloStudy(
        partial(
            forgetting_vaf,
            memory_horizons=horizons,
            window=around,
            init_window=first,
            scaled=True,
            by_run=True,
        ),
        _cells(task, remnant_intensity),
        n_replications,
        n_validation_runs=n_validation,
        simulation={"keep_run_in": _kept_run_in(task)},
        batched=True,
        block_size=25,
        random_state=random_state,
    )
    table = study.run(out, n_jobs=n_jobs, progress=progress).drop(columns="condition")
    if table["error"].notna().all():
        raise ValueError(f"Every simulated run failed. The first error: {table['error'].iloc[0]}")
    if "remnant_intensity" not in table:
        table.insert(0, "remnant_intensity", table["P_n"].mean())
    return _advice(table, around, rate)


def _advice(table: pd.DataFrame, window: tuple[float, float], rate: float) -> ForgettingAdvice:
    good = table[table["error"].isna()]
    of_lambda = good[good["form"] == "lambda"]
    vaf = of_lambda.pivot(index=RUNS, columns="memory_horizon", values="vaf_validation")
    best = float(vaf.mean().idxmax())
    worse = vaf.rsub(vaf[best], axis=0)
    near = worse.mean() <= SIGNIFICANT * _crossed_standard_error(worse)  # not where it is NaN
    close = [float(N0) for N0 in vaf.columns if best == N0 or near[N0]]
    if np.inf in close:
        best = np.inf
    grouped = with_gain(good, RUNS).groupby(["remnant_intensity", *SETTING])
    summary = grouped[["vaf_estimation", "vaf_validation", "gain"]].mean()
    summary["se_gain"] = [
        _crossed_standard_error(part.set_index(RUNS)[["gain"]])["gain"] for _, part in grouped
    ]
    return ForgettingAdvice(
        memory_horizon=best,
        close=close,
        gain=float(vaf[best].mean() - vaf[np.inf].mean()),
        summary=summary,
        table=table,
        window=window,
        sampling_rate=rate,
    )


def _crossed_standard_error(values: pd.DataFrame) -> pd.Series:
    """Standard errors of means over estimation and validation runs, both random.

    Both vary: var(mean) = var_e / n_e + var_v / n_v, where each is the variance of means over the
    other kind (crossed random effects; their interaction is counted twice, which errs on the safe
    side). NaN with a single run of either.
    """
    levels = ["remnant_intensity", "replication"], ["remnant_intensity", "validation"]
    variance: Any = 0.0
    for level in levels:
        means = values.groupby(level).mean()
        variance = variance + means.groupby("remnant_intensity").var().div(
            means.groupby("remnant_intensity").count()
        )
    return np.sqrt(variance.mean() / len(variance))


def _cells(task: CompensatoryTask, intensity: Any) -> list[dict[str, Any]]:
    if intensity is None:
        if task.remnant is None or not (task.remnant.gain or task.remnant.intensity):
            raise ValueError(
                "Give remnant_intensity, such as 0.15: without remnant the shortest memory is "
                "always best."
            )
        return [{"condition": task}]
    wanted = [float(P_n) for P_n in np.atleast_1d(intensity)]
    if min(wanted) <= 0:
        raise ValueError(
            f"remnant_intensity must be above 0, since without remnant the shortest memory is "
            f"always best; got {intensity!r}."
        )
    still = replace(task, remnant=None)
    return [{"condition": still, "remnant_intensity": P_n, "remnant_order": 2} for P_n in wanted]


def _change_window(task: CompensatoryTask) -> tuple[float, float] | None:
    """Seconds around the change of a task's parameters; None where nothing changes in the run."""
    times = change_times(task)
    if times is None:
        return None
    early, middle, late = times
    half = max(HALF_WIDTH * task.duration, WIDER * (late - early))
    return max(0.0, middle - half), min(task.duration, middle + half)
