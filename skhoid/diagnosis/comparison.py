"""``compare`` and ``Comparison``: a fitted model against measured runs."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from scipy.stats import norm

from .._sklearn import DT, ROLES, RUN_IN, HasMethods, StrOptions, checked
from ..metrics import fit_percent, vaf_of_rows
from ..pipelines import taken_apart
from ..preprocessing.base import as_fitted
from ..recordings.channels import check_channels
from ..recordings.recording import Finding
from ..text import Document, Note, Told, ceiling_text
from .ceiling import Ceiling, Route, consistent_ceiling, noise_ceiling
from .findings import WORDS, NextSteps, advise
from .leaks import LEAST_DELAY, LeakTest, leak_test
from .over_amplitude import by_operating_point, level_tests
from .over_frequency import by_frequency, distortion_tests
from .over_runs import by_run, tests_over_runs
from .over_time import BlockSums, by_time, tests_of_changes, time_frequency
from .response import correlations, delay_test, linear_misfit
from .signals import Signals, read_signals
from .telling import gather_figures, tell_comparison
from .tests_table import FALSE_ALARM, Test, tests_table

MEAN = 0.5  # of the power of the output; more in its mean makes VAF about zero say little
CONSTANT = 1 - 1e-9  # the same of an output that does not move
OVERFIT = 1.1  # mean squared error of validation over that of estimation (thesis)


@dataclass(frozen=True)
class Figures:
    """How good the predictions are.

    Parameters
    ----------
    vaf, vaf_about_mean : float
        VAF of the free run on all scored rows, in percent, unclipped: about zero, and about the
        mean of the output (NaN where it is constant).
    mean_share : float
        Share (0 to 1) of the output's power that is due to its mean; above one half, texts are
        about the mean.
    one_step_vaf : float
        VAF one step ahead; NaN for a model that makes no such prediction.
    fit : float
        The fit that MATLAB's ``compare`` prints, in percent, from the VAF about the mean.
    rmse, offset : float
        Root mean squared, and mean residual (measured less simulated) of the free run, in the unit
        of the output.
    estimation_vaf : float
        VAF on the runs given as ``estimation``; NaN if there are none.
    overfit_ratio : float
        Mean squared residual over the output's power, on validation over estimation runs.
    """

    vaf: float
    vaf_about_mean: float
    mean_share: float
    one_step_vaf: float
    fit: float
    rmse: float
    offset: float
    estimation_vaf: float
    overfit_ratio: float

    @property
    def overfit(self) -> bool | None:
        """Whether the ratio exceeds 1.1; None without estimation runs."""
        return None if np.isnan(self.overfit_ratio) else bool(self.overfit_ratio > OVERFIT)


@dataclass(frozen=True)
class NoiseCeiling:
    """The VAF that a model driven by the measured signals could reach, at least.

    It is a lower bound: what is missing and does not repeat looks like noise.

    Parameters
    ----------
    value : float
        Between the VAF of the model and 100; NaN if it is not known.
    interval : (float, float)
        Its 95 % confidence interval if nothing is missing; a better model may exceed it.
    gap : float
        Estimated ceiling minus VAF, in VAF points.
    route : Route
        How it was found.
    note : Note
        The same as a sentence; why it is not known, where it is not (a ``NoCeiling`` as its kind).
    """

    value: float
    interval: tuple[float, float]
    gap: float
    route: Route
    note: Note


@dataclass(frozen=True)
class Views:
    """The residual row by row, and by run, time, frequency and amplitude, as tables.

    Parameters
    ----------
    traces : DataFrame
        ``measured``, ``predicted``, ``residual``, ``one_step``, ``scored`` and the channels with
        a role, row by row.
    by_run, by_time, by_frequency, by_operating_point : DataFrame
        The residual by run, by window of time in the run, by frequency, and by value of signals.
        A window with less than the others ``exceeds`` chance too; ``explainable`` is the part of
        ``share`` (VAF points lost) that repeats over runs.
    correlations : DataFrame
        Cross-correlation of the prewhitened residual with signals, by lag.
    time_frequency : DataFrame
        Power of the residual over time (index, s) and frequency (columns, rad/s), relative to
        the noise expected there.
    """

    traces: pd.DataFrame
    by_run: pd.DataFrame
    by_time: pd.DataFrame
    by_frequency: pd.DataFrame
    by_operating_point: pd.DataFrame
    correlations: pd.DataFrame
    time_frequency: pd.DataFrame


@dataclass(frozen=True, repr=False)
class Comparison(Told):
    """What :func:`compare` found.

    The members of its parts are its own too: ``comparison.vaf`` is ``comparison.figures.vaf``,
    ``comparison.by_run`` is ``comparison.views.by_run``; ``noise_ceiling``,
    ``noise_ceiling_interval``, ``explainable_gap``, ``ceiling_route`` ("repeats", "lines",
    "inputs" or "none") and ``ceiling_note`` are of ``comparison.ceiling``.

    Parameters
    ----------
    model_name, output : str
        The model, and the name of the measured output.
    unit : str or None
        Unit of the output.
    dt : float
        Sampling time in s.
    domain : {"human", "machine"}
        Wording of the findings.
    figures : Figures
        How good the predictions are.
    ceiling : NoiseCeiling
        How good those of any model could be.
    leak : LeakTest or None
        Whether the prediction is the output rebuilt from x, where x is known.
    views : Views
        Where the residual is, as tables.
    tests : DataFrame
        One row per test; ``p`` accounts for the search inside the test, ``exceeds`` is p < 0.01;
        ``cost`` is in VAF points; ``valid`` is False for what is described but not tested.
    notes : list of Note
        What was left out.
    findings : list of Finding
        What the results mean and what to do next, most important first.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs
    >>> X, y = make_tracking_runs("C1", n_runs=3, remnant_intensity=0.1, random_state=0)
    >>> compare(ARXRegressor(nk=29).fit(X, y), X, y, repeats=True).ceiling_route
    'repeats'
    """

    false_alarm: ClassVar[float] = FALSE_ALARM

    model_name: str
    output: str
    unit: str | None
    dt: float
    domain: str
    figures: Figures
    ceiling: NoiseCeiling
    leak: LeakTest | None
    views: Views
    tests: pd.DataFrame
    notes: list[Note]
    findings: list[Finding] = field(default_factory=list)

    vaf = property(attrgetter("figures.vaf"))
    vaf_about_mean = property(attrgetter("figures.vaf_about_mean"))
    mean_share = property(attrgetter("figures.mean_share"))
    one_step_vaf = property(attrgetter("figures.one_step_vaf"))
    fit = property(attrgetter("figures.fit"))
    rmse = property(attrgetter("figures.rmse"))
    offset = property(attrgetter("figures.offset"))
    estimation_vaf = property(attrgetter("figures.estimation_vaf"))
    overfit_ratio = property(attrgetter("figures.overfit_ratio"))
    overfit = property(attrgetter("figures.overfit"))
    noise_ceiling = property(attrgetter("ceiling.value"))
    noise_ceiling_interval = property(attrgetter("ceiling.interval"))
    explainable_gap = property(attrgetter("ceiling.gap"))
    ceiling_route = property(attrgetter("ceiling.route.value"))
    ceiling_note = property(attrgetter("ceiling.note.with_hint"))
    traces = property(attrgetter("views.traces"))
    by_run = property(attrgetter("views.by_run"))
    by_time = property(attrgetter("views.by_time"))
    by_frequency = property(attrgetter("views.by_frequency"))
    by_operating_point = property(attrgetter("views.by_operating_point"))
    correlations = property(attrgetter("views.correlations"))
    time_frequency = property(attrgetter("views.time_frequency"))

    def __repr__(self) -> str:
        ceiling = (
            "" if np.isnan(self.noise_ceiling) else f", ceiling {ceiling_text(self.noise_ceiling)}"
        )
        return f"<Comparison of {self.model_name}: VAF {self.vaf:.1f} %{ceiling}>"

    @property
    def mean_dominates(self) -> bool:
        """Whether the mean of the output holds more than half of its power."""
        return MEAN < self.mean_share < CONSTANT

    @property
    def point_scale(self) -> float:
        """Points about the mean for each VAF point, where the mean dominates; else 1."""
        return 1 / (1 - self.mean_share) if self.mean_dominates else 1.0

    def about_mean(self, vaf: float) -> float:
        """A VAF or ceiling as texts give it: about the mean where that dominates.

        Parameters
        ----------
        vaf : float
            About zero, in percent.

        Returns
        -------
        vaf : float
        """
        return 100 - self.point_scale * (100 - vaf)

    def document(self) -> Document:
        """How good the model is, where it fails, and what to do next.

        Returns
        -------
        document : Document
        """
        return tell_comparison(self)

    def as_dict(self) -> dict[str, Any]:
        """Figures, leak test, findings and notes, for JSON.

        Returns
        -------
        found : dict
        """
        return gather_figures(self)

    def explore(self) -> Any:
        """Look by hand, in a notebook: brush time, frequency or amplitude, and see the others.

        Returns
        -------
        widget : anywidget.AnyWidget
            The last expression of a cell shows it.

        Raises
        ------
        ImportError
            Without anywidget: ``pip install "skhoid[notebook]"``.
        """
        from ..lab.explore.component import of_comparison

        return of_comparison(self)

    def plot(self, kind: str = "overview", *, ax: Any = None) -> Any:
        """Draw, as :class:`skhoid.plotting.ComparisonDisplay` does.

        Parameters
        ----------
        kind : str, default="overview"
            What to draw: overview, ceiling, runs, time, frequency, amplitude, map or correlation.
        ax : Axes, sequence of Axes or None, default=None
            Axes to draw on; None makes a figure.

        Returns
        -------
        display : ComparisonDisplay
        """
        from ..plotting import ComparisonDisplay

        return ComparisonDisplay.from_comparison(self, kind, ax=ax)


@checked(
    model=[HasMethods("predict")],
    repeats=[bool, Mapping, "array-like", None],
    roles=ROLES,
    run_in=RUN_IN,
    domain=[StrOptions({*WORDS}), None],
    dt=DT,
)
def compare(
    model: Any,
    X: Any,
    y: Any,
    *,
    estimation: tuple[Any, Any] | None = None,
    repeats: Any = None,
    roles: dict[Any, str] | None = None,
    run_in: float | None = None,
    domain: str | None = None,
    dt: float | None = None,
    run: Any = None,
) -> Comparison:
    """Compare a fitted model with measured runs: how good, where it fails, what is left to explain.

    Parameters
    ----------
    model : fitted regressor, pipeline or search
        Anything with ``predict``. One-step figures come from ``predict_ahead``, if there is one.
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels of the validation runs, one row per sample. Roles are taken from the names of
        columns: ``e``, ``x``, ``f_t``, ``dist...``. A missing target is computed as e + x.
    y : Series or array of shape (n_rows,)
        Measured output.
    estimation : (X, y) or None, default=None
        Runs that the model was fitted to. They are scored separately, to check for overfitting.
    repeats : None, bool, dict or sequence, default=None
        Which runs share the target: those whose ``f_t`` are equal (None), all (True), none (False),
        or those with the same label in ``{run: label}`` or in a sequence of one label per run.
    roles : dict or None, default=None
        ``{column: role}`` for columns that are not named by their role. None takes those of the
        model.
    run_in : float or None, default=None
        Leave out this many seconds at the start of each run.
    domain : {"human", "machine"} or None, default=None
        Wording of the findings, and how soon a response can come: a person's not within 0.1 s. None
        means a person if the model is an OperatorRegressor, or if there are an error and x or f_t;
        otherwise a machine.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: that of the model, or 1).
    run : column name or position, or None, default=None
        Run column of ``X`` for data without a run index.

    Returns
    -------
    comparison : Comparison

    Raises
    ------
    ValueError
        If no row is left to score, the model predicts NaN, or ``repeats`` names unknown runs.

    See Also
    --------
    remnant_estimate : Intensity and spectrum of the remnant.
    performance_scores : Scores and windows of an experiment.
    check_channels : Checks units, clocks and copies of the recorded channels.

    Notes
    -----
    The residual of run k is r_k = d + n_k: a misfit d that repeats with the target, and remnant
    n_k. The ceiling is 100 (1 - Σn²/Σu²) with Σn² from the part of r that does not repeat. Tests
    use patterns that are independent of the remnant of their own run, and so are valid in a closed
    loop. A finding does not prove a cause: see its meaning. An operator is compared by its
    ``parameters_`` even where ``predict`` simulates with those of least error: a note says so.

    Examples
    --------
    >>> from skhoid import ARXRegressor, compare, make_tracking_runs, select_runs
    >>> X, y = make_tracking_runs(
    ...     "C3", n_runs=6, channels=["e", "x", "f_t"], remnant_intensity=0.1, random_state=0
    ... )
    >>> model = ARXRegressor(nk=29).fit(*select_runs(X, y, first=3))
    >>> comparison = compare(model, *select_runs(X, y, last=3))
    >>> bool(comparison.vaf < comparison.noise_ceiling)
    True
    """
    options = {"roles": roles, "run_in": run_in, "dt": dt, "run": run}
    signals = read_signals(model, X, y, repeats=repeats, **options)
    fitted = None
    if estimation is not None:
        if not isinstance(estimation, (tuple, list)) or len(estimation) != 2:
            raise TypeError(
                "estimation must be the pair (X, y) of the runs that the model was fitted to."
            )
        fitted = read_signals(model, *estimation, repeats=False, **options)
    vaf = _pooled(signals, signals.predicted)  # which refuses an output of zeros
    of_channels = check_channels(X, y, dt=dt, run=run)
    if signals.lost_alone:  # the output was not missing in the recording
        kind = "missing samples", signals.output
        of_channels = [one for one in of_channels if (one.name, one.about) != kind]
    domain = domain or _domain(signals)
    leak = _leak(signals, domain)
    ceiling = noise_ceiling(signals)
    views, tests = _look(signals, ceiling, fitted)
    found = Comparison(
        model_name=_find_name(model),
        output=signals.output,
        unit=signals.units.get(signals.output),
        dt=signals.dt,
        domain=domain,
        figures=_figures(signals, vaf, fitted),
        ceiling=_find_ceiling(ceiling, vaf, held_out=fitted is not None),
        leak=leak,
        views=views,
        tests=tests_table([*tests, *_leak_row(signals, leak)]),
        notes=signals.notes,
    )
    return replace(found, findings=advise(found, signals, of_channels))


def _figures(signals: Signals, vaf: float, fitted: Signals | None) -> Figures:
    """How good the predictions are, also on the runs that the model was fitted to."""
    scored = signals.y[signals.scored]
    mean_share = float(np.mean(scored) ** 2 / np.mean(scored**2))
    moves = mean_share < CONSTANT
    ahead = np.isfinite(signals.one_step)
    own, ratio = np.nan, np.nan
    if fitted is not None:
        own = _pooled(fitted, fitted.predicted)
        # Both relative to the power of their output, which differs between runs.
        ratio = (100 - vaf) / (100 - own) if own < 100 else np.nan
    about_mean = 100 - (100 - vaf) / (1 - mean_share) if moves else np.nan
    residual = signals.residual[signals.scored]
    return Figures(
        vaf=vaf,
        vaf_about_mean=about_mean,
        mean_share=mean_share,
        one_step_vaf=_pooled(signals, signals.one_step, ahead) if ahead.any() else np.nan,
        fit=fit_percent(about_mean),
        rmse=float(np.sqrt(np.mean(residual**2))),
        offset=float(np.mean(residual)),
        estimation_vaf=own,
        overfit_ratio=ratio,
    )


def _find_ceiling(ceiling: Ceiling, vaf: float, held_out: bool) -> NoiseCeiling:
    """The ceiling to show, or why it is not known."""
    estimate = vaf + ceiling.gap
    top, reason = consistent_ceiling(estimate, vaf, ceiling.sd, held_out=held_out)
    if reason is not None or not ceiling.known:
        nothing = (np.nan, np.nan)
        return NoiseCeiling(np.nan, nothing, np.nan, Route.NONE, reason or ceiling.note)
    half = (ceiling.interval[1] - ceiling.interval[0]) / 2
    interval = min(estimate - half, top), min(max(estimate + half, top), 100.0)
    gap = min(ceiling.gap, 100 - vaf)
    return NoiseCeiling(top, interval, gap, ceiling.route, ceiling.note)


def _look(signals: Signals, ceiling: Ceiling, fitted: Signals | None) -> tuple[Views, list[Test]]:
    """Where the residual is, and every test of it."""
    runs = by_run(signals, "validation")
    p, of_runs = tests_over_runs(signals, ceiling)
    runs["p"], runs["exceeds"] = p, p < FALSE_ALARM
    if fitted is not None:
        runs = pd.concat([runs, by_run(fitted, "estimation")], ignore_index=True)
    correlation, of_correlation = correlations(signals, ceiling)
    amplitude, of_amplitude = by_operating_point(signals, ceiling)
    sums = BlockSums.of(signals, ceiling)
    linear = linear_misfit(signals, ceiling)
    lag = next((test.size for test in linear if test.test == "lag"), 0.0)
    tests = [
        *_gap_test(ceiling),
        *linear,
        *delay_test(signals, ceiling, lag),
        *tests_of_changes(signals, ceiling, sums),
        *distortion_tests(signals, ceiling),
        *of_correlation,
        *of_amplitude,
        *level_tests(signals),
        *of_runs,
    ]
    views = Views(
        by_run=runs,
        by_time=by_time(signals, ceiling),
        by_frequency=by_frequency(signals, ceiling),
        by_operating_point=amplitude,
        correlations=correlation,
        time_frequency=time_frequency(signals, ceiling),
        traces=_traces(signals),  # the largest last, when the others need no more room
    )
    return views, tests


def _pooled(signals: Signals, prediction: np.ndarray, known: np.ndarray | None = None) -> float:
    keep = signals.scored if known is None else signals.scored & known
    return float(vaf_of_rows(signals.y, prediction, keep, signals.layout, "pooled", False))


def _gap_test(ceiling: Ceiling) -> list[Test]:
    if not ceiling.known or ceiling.sd == 0:
        return []
    z = ceiling.gap / ceiling.sd
    return [
        Test(
            "explainable gap",
            "residual",
            z,
            float(norm.sf(z)),
            size=ceiling.gap,
            cost=ceiling.gap,
            description="power of what the residual owes to what comes from outside, in VAF points",
        )
    ]


def _domain(signals: Signals) -> str:
    if NextSteps(signals.model).is_controller:
        return "machine"
    loop = "e" in signals.channels and not {"x", "f_t"}.isdisjoint(signals.channels)
    return "human" if loop or NextSteps(signals.model).is_operator else "machine"


def _leak(signals: Signals, domain: str) -> LeakTest | None:
    """Whether the model rebuilds the output from x; None where x is not known, to it or at all."""
    model = NextSteps(signals.model)
    if model.from_outside:
        return None
    return leak_test(
        np.where(signals.scored, signals.y, np.nan),
        signals.free_run,
        signals.channels,
        signals.dt,
        [slice(*rows) for rows in itertools.pairwise(signals.layout.stretches)],
        told=model.is_told,
        least_delay=LEAST_DELAY if domain == "human" else signals.dt,
    )


def _leak_row(signals: Signals, leak: LeakTest | None) -> list[Test]:
    if leak is None or leak.leaks is None:
        return []
    return [
        Test(
            "leak",
            signals.output,
            leak.slope / leak.sd if leak.sd > 0 else np.inf,
            np.nan,
            size=leak.slope,
            description="part of the unseen disturbance that the prediction holds at once",
            rule=leak.leaks,
        )
    ]


def _find_name(model: Any) -> str:
    steps, last = taken_apart(model)
    # As they were fitted: parameters may have been set since.
    told = [(step, as_fitted(step)) for step in [*steps, last]]
    shown = [step if was is step else type(step)(**vars(was)) for step, was in told]
    names = [" ".join(repr(step).split()) for step in shown]
    return re.sub(r" at 0x[0-9a-f]+", "", " → ".join(names))


def _traces(signals: Signals) -> pd.DataFrame:
    columns = {
        "measured": signals.y,
        "predicted": signals.free_run,
        "residual": None,
        "one_step": signals.one_step,
        **signals.channels,
    }
    table = np.empty((len(columns), len(signals.y)))  # nothing else takes room beside it
    for into, values in zip(table, columns.values(), strict=True):
        if values is None:
            np.subtract(signals.y, signals.free_run, out=into)
        else:
            into[:] = values
    traces = pd.DataFrame(table.T, index=signals.index, columns=list(columns), copy=False)
    traces.insert(4, "scored", signals.scored.copy())
    return traces
