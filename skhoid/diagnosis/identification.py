"""The thesis's identification procedure, step by step, on recorded runs (its Section III-D).

Rows in which control was lost are left out first, and models that rebuild the output from what it
caused are refused at the end.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.utils import check_array

from ..arx.base import UNSTABLE
from ..arx.batch import ARXRegressor
from ..arx.least_delay import LeastDelay, find_least_delay
from ..arx.recursive import RecursiveARX
from ..arx.searches import DelaySearchCV, OrderSearchCV
from ..exceptions import MissingDataWarning, UsageError
from ..metrics import VAFScorer, fit_percent, scored_rows, vaf_of_rows
from ..pipelines import prediction_from, trimmed_rows
from ..preprocessing import Decimator, RunInTrimmer
from ..preprocessing.gate import AS_GIVEN, as_column
from ..recordings.loss_of_control import (
    CHOICES,
    KEEP,
    LEAVE_OUT,
    ControlCheck,
    control_check,
    notes_of_lost,
)
from ..runs import RunLayout, empty_runs, read_layout, rows_of_runs, run_name, whole_samples
from ..runs.roles import columns_by_role, input_columns
from ..runs.selection import run_labels
from ..text import Note
from .leaks import (
    LEAST_DELAY,
    SLOPE,
    LeakTest,
    can_have_learnt,
    count_independent,
    leak_test,
)
from .signals import find_growth

LONGEST_DELAY = 0.5  # s
SHARE = 0.1  # of a run, that a delay which is tried takes at most: folds are thirds of it
WORSE_BY = 1.0  # points of VAF
OVERFIT_RATIO = 1.1  # of VAF on estimation to VAF on validation data, the thesis's example
SLOPE_OF_X = 0.15  # of the unseen disturbance that a regression on x holds at once, at most
OPPOSED = -0.15  # correlation, below which a residual opposes what the prediction holds


class Verdict(StrEnum):
    """What the validation says of a model."""

    UNSTABLE = "unstable"
    REBUILDS = "rebuilds the output from the controlled element's response"
    UNTOLD = "cannot be told apart from the controlled element's inverse"
    FAILS = "fails on validation data"
    OVERFIT = "overfit"
    WORSE = "worse held out"
    GOOD = "no overfit"


@dataclass(frozen=True, kw_only=True)
class ModelChoice:
    """What the caller fixes: orders and delay that are None are searched for.

    Orders are not searched if ``na`` or ``nb`` is given. ``memory`` (``memory_time`` or
    ``memory_horizon`` of a RecursiveARX) adds a model that follows the data. Where e or x are
    inputs, no delay below ``least_delay`` (s) is tried: 0.1 s of a person, one sample of a machine.
    """

    inputs: list[str] | None = None
    na: int | None = None
    nb: Any = None
    nk: Any = None
    method: str = "ols"
    instruments: list[str] | None = None
    memory: dict[str, Any] | None = None
    least_delay: float | None = None
    domain: str | None = None
    roles: Mapping[Any, Any] | None = None
    lost_control: str = LEAVE_OUT


@dataclass(frozen=True)
class FittedModel:
    """A model with its free-run VAF on fitted and held-out rows, and its leak test, if possible.

    ``fit`` is that of MATLAB's ``compare`` and ``offset`` the mean residual, both held out;
    ``spare`` are the samples by which a person's answer to x is later than the least delay,
    ``growth`` the logarithm of how much a free run grows by itself, ``independent`` the number of
    independent values that were fitted.
    """

    name: str
    pipeline: Pipeline
    vaf_estimation: float
    vaf_validation: float
    fit: float
    offset: float
    free_run: np.ndarray
    leak: LeakTest | None = None
    spare: float = np.inf
    growth: float = -np.inf
    independent: float = np.inf

    @property
    def model(self) -> Any:
        return self.pipeline[-1]

    @property
    def ratio(self) -> float:
        return self.vaf_estimation / self.vaf_validation

    @property
    def leaks(self) -> bool:
        """Whether the model is refused: it responds to what nobody could see."""
        return self.leak is not None and self.leak.leaks is True

    @property
    def untold(self) -> bool:
        """Whether it could as well rebuild the output: too soon, or just so and not tested."""
        tested = self.leak is not None and self.leak.leaks is not None
        return self.spare < 0 or (self.spare <= 1 and not tested)

    @property
    def verdict(self) -> Verdict:
        if self.growth > UNSTABLE:
            return Verdict.UNSTABLE
        if self.leaks:
            return Verdict.REBUILDS
        if self.untold:
            return Verdict.UNTOLD
        if self.vaf_validation <= 0:
            return Verdict.FAILS
        if self.ratio <= OVERFIT_RATIO:
            return Verdict.GOOD
        worse = (100 - self.vaf_validation) / max(100 - self.vaf_estimation, 1e-9)
        many = can_have_learnt(len(self.model.parameter_names_), self.independent, worse)
        return Verdict.OVERFIT if many else Verdict.WORSE

    def as_dict(self) -> dict[str, Any]:
        model, leak = self.model, self.leak
        names = model.parameter_names_
        numbers = zip(names, model.coef_.tolist(), model.standard_errors_.tolist(), strict=True)
        return {
            "name": self.name,
            "na": model.orders_.na,
            "nb": list(model.orders_.nb),
            "nk": list(model.orders_.nk),
            "delay_s": [k * model.dt_ for k in model.orders_.nk],
            "vaf_estimation": self.vaf_estimation,
            "vaf_validation": self.vaf_validation,
            "ratio": self.ratio,
            "fit_validation": self.fit,
            "offset_validation": self.offset,
            "verdict": self.verdict.value,
            "leaks": leak.leaks if leak is not None else None,
            "leak_slope": leak.slope if leak is not None and leak.leaks is not None else None,
            "leak_reason": leak.reason if leak is not None else None,
            "parameters": [
                {"name": name, "value": value, "standard_error": error}
                for name, value, error in numbers
            ],
        }


@dataclass(frozen=True)
class Identification:
    """What :func:`identify` found."""

    X: pd.DataFrame
    y: pd.Series
    layout: RunLayout
    held_out: np.ndarray
    estimation: str
    validation: str
    centered: bool
    delay_searches: dict[str, DelaySearchCV]
    order_search: OrderSearchCV | None
    models: list[FittedModel]
    adapting: FittedModel | None
    least_delay: LeastDelay
    left_out: pd.DataFrame
    notes: list[Note]

    @property
    def units(self) -> dict[str, str]:
        """Units of the channels that have one."""
        return {**self.X.attrs.get("units", {}), **self.y.attrs.get("units", {})}

    @property
    def n_gaps(self) -> int:
        """Gaps in time, at which the free run starts anew from zero."""
        return self.layout.starts.size - self.layout.run_starts.size

    @property
    def held_out_view(self) -> dict[str, Any]:
        """Which runs, or which part of a single run, a plot of the validation shows."""
        first = np.flatnonzero(self.held_out)[0]
        if len(self.layout.labels) == 1:
            end = float(self.layout.time[-1]) + self.layout.dt
            return {"window": (float(self.layout.time[first]), end)}
        return {"runs": list(dict.fromkeys(run_labels(self.X)[self.held_out].tolist()))}

    @property
    def best(self) -> FittedModel:
        """The model with the searched, or given, delay and orders; no answer where it ``leaks``."""
        return self.models[-1]

    @property
    def fitted(self) -> list[FittedModel]:
        """All models, the one that follows changes last."""
        return [*self.models, *([self.adapting] if self.adapting else [])]

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Everything found, as tables by name."""
        flat = [model.as_dict() for model in self.fitted]
        parameters = [{"model": m["name"], **p} for m in flat for p in m.pop("parameters")]
        free_runs = {m.name.replace(" ", "_"): m.free_run for m in self.fitted}
        tables = {
            "models": pd.DataFrame(flat),
            "parameters": pd.DataFrame(parameters),
            "predictions": pd.DataFrame(
                {"measured": self.y, **free_runs, "held_out": self.held_out}, index=self.X.index
            ),
        }
        if len(self.left_out):
            tables["left_out"] = self.left_out
        if self.delay_searches:
            columns = [
                pd.DataFrame(s.cv_results_)
                .drop(columns="params")
                .set_index(["nk", "delay"])
                .rename(columns={"loss": f"{criterion}_loss"})
                for criterion, s in self.delay_searches.items()
            ]
            tables["delays"] = pd.concat(columns, axis=1)
        if self.order_search is not None:
            tables["orders"] = pd.DataFrame(self.order_search.cv_results_).drop(columns="params")
        if self.adapting is not None:
            model = self.adapting.pipeline[-1]
            tables["parameter_path"] = pd.DataFrame(
                model.coef_path_,
                index=pd.Index(model.time_path_, name="time"),
                columns=model.parameter_names_,
            )
        return tables


def identify(
    X: pd.DataFrame,
    y: pd.Series,
    choice: ModelChoice,
    *,
    run_in: float | None = None,
    factor: int = 1,
    longest_delay: float | None = None,
    validation_runs: list[Any] | None = None,
    centered: bool = True,
    callbacks: tuple[Any, ...] = (),
) -> Identification:
    """Discard the run-in, find delay and orders, fit, and validate on held-out data.

    The last run is held out, or ``validation_runs``, or the second half of a single run. With
    ``centered`` the models have an intercept, and VAF is about the mean of each measured run.
    The longest delay to try is ``LONGEST_DELAY``, or less in runs that are too short for it.
    """
    layout = read_layout(X)
    seen = _Measured.of(X, y, layout, choice, run_in)
    held_out, names = _held_out_rows(layout, validation_runs, run_in or 0.0)
    fixed_orders = choice.na is not None or choice.nb is not None
    orders: dict[str, Any] = {
        "na": 2 if choice.na is None else choice.na,
        "nb": 2 if choice.nb is None else choice.nb,
        "nk": 0 if choice.nk is None else choice.nk,
    }
    model = ARXRegressor(**orders, inputs=choice.inputs, fit_intercept=centered, covariance="hac")
    steps = [RunInTrimmer(run_in), Decimator(factor)]
    pipeline = make_pipeline(Decimator(factor), model)
    scorer = VAFScorer(centered=centered)
    X_e, y_e = X[~held_out], seen.output[~held_out]
    # Folds of what is kept: of a single run, they would be cut out of the run-in too.
    searched = ~held_out & scored_rows(layout, run_in, None)
    X_s, y_s = X[searched], seen.output[searched]

    least = find_least_delay(
        list(X.columns) if choice.inputs is None else choice.inputs,
        list(X.columns),
        layout.dt * factor,
        seconds=choice.least_delay,
        domain=choice.domain,
        roles=choice.roles,
    )
    candidates = {}
    searches = {}
    if choice.nk is None:
        # e alone is not x: without delay it is no model of the element, and a yardstick.
        shortest = least.samples if least.closed else 0
        without = "with the least delay" if shortest else "without delay"
        candidates[without] = {**orders, "nk": shortest}
        shortest_run = float(np.diff(layout.run_starts).min()) * layout.dt
        if longest_delay is None:
            longest_run = np.bincount(layout.run_of(np.flatnonzero(searched))).max() * layout.dt
            longest_delay = min(LONGEST_DELAY, SHARE * longest_run, shortest_run / 2)
            longest_delay = max(longest_delay, least.seconds)
        longest = int(np.floor(whole_samples(longest_delay, layout.dt * factor)))
        if longest < least.samples:
            raise UsageError(
                f"The longest delay to try, {longest_delay:g} s, is below the least, "
                f"{least.seconds:.3g} s, of rows {layout.dt * factor:.3g} s apart: "
                f"{least.reason}. Allow a longer one, or a smaller least_delay.",
                options=["longest_delay", "least_delay"],
            )
        if longest_delay > shortest_run / 2:
            raise UsageError(
                f"The longest delay to try, {longest_delay:g} s, is more than half of the "
                f"shortest run, {shortest_run:.3g} s. Allow a shorter one.",
                options=["longest_delay"],
            )
        # Of a person "impulse" is early: by 1.6 samples where one_step is 1 late, simulated at 50
        # Hz with C1 and C2; at no delay in a recording of a person who follows a smooth target.
        person = least.domain == "human" or "f_t" in seen.columns
        for how in ("one_step", "vaf") if person else ("impulse", "one_step", "vaf"):
            search = DelaySearchCV(
                pipeline, nk=range(least.samples, longest + 1), criterion=how, scoring=scorer
            ).set_callbacks(*callbacks)
            searches[how] = search.fit(X_s, y_s)
        orders = {**orders, "nk": next(iter(searches.values())).best_nk_}
        candidates["with delay"] = orders
    else:
        candidates["as given" if fixed_orders else "with the delay given"] = orders
    order_search = None
    if not fixed_orders:
        pipeline.set_params(arxregressor__nk=orders["nk"])
        order_search = OrderSearchCV(pipeline, nk=[orders["nk"]], scoring=scorer)
        order_search.set_callbacks(*callbacks).fit(X_s, y_s)
        orders = {name: order_search.best_params_[name] for name in ("na", "nb", "nk")}
        candidates["with delay and orders"] = orders

    independent = count_independent(seen.output[~held_out].dropna().to_numpy(), layout.dt)

    def fitted(name: str, model: Any) -> FittedModel:
        with seen.left_out_quietly():
            pipeline = make_pipeline(*map(clone, steps), model).fit(X_e, y_e)
            prediction, _ = prediction_from(pipeline, X, seen.output)
        u, keep = seen.output.to_numpy(dtype=float), ~trimmed_rows(pipeline, X)
        of_fit, of_others, about_mean = (
            vaf_of_rows(u, prediction, keep & rows, layout, "pooled", about)
            for rows, about in ((~held_out, centered), (held_out, centered), (held_out, True))
        )
        offset = float(np.nanmean((u - prediction)[keep & held_out]))
        leak = seen.leak(pipeline[-1], prediction, keep, least)
        spare, growth = _spare(pipeline[-1], least), find_growth(pipeline, X)
        fit = fit_percent(about_mean)
        figures = of_fit, of_others, fit, offset
        return FittedModel(name, pipeline, *figures, prediction, leak, spare, growth, independent)

    model.set_params(method=choice.method, instruments=choice.instruments)
    models = [fitted(name, clone(model).set_params(**found)) for name, found in candidates.items()]
    adapting = None
    if choice.memory:
        follows = RecursiveARX(
            **orders, inputs=choice.inputs, fit_intercept=centered, **choice.memory
        )
        adapting = fitted("following changes", follows)
    notes = [Note("delay", text) for text in least.notes(orders["nk"], given=choice.nk is not None)]
    notes += notes_of_lost(seen.left_out)
    notes += _note_worse(models)
    notes += [
        note for m in (models[-1], adapting) if m is not None for note in _leak_notes(m, least)
    ]
    return Identification(
        X,
        y,
        layout,
        held_out,
        *names,
        centered,
        searches,
        order_search,
        models,
        adapting,
        least,
        seen.left_out,
        notes,
    )


@dataclass(frozen=True)
class _Measured:
    """Channels by role, and the output, which is missing where control was lost."""

    layout: RunLayout
    columns: dict[str, str]
    channels: dict[str, np.ndarray]
    output: pd.Series
    left_out: pd.DataFrame
    complete: bool

    @classmethod
    def of(
        cls,
        X: pd.DataFrame,
        y: pd.Series,
        layout: RunLayout,
        choice: ModelChoice,
        run_in: float | None,
    ) -> _Measured:
        if choice.lost_control not in CHOICES:
            raise ValueError(
                f"lost_control must be 'leave_out' or 'keep'; got {choice.lost_control!r}."
            )
        of_role = columns_by_role(list(X.columns), choice.roles)
        channels = {role: as_column(X.iloc[:, i]) for role, i in of_role.items()}
        inputs = input_columns(list(X.columns), X.shape[1], choice.inputs, None, choice.roles)
        needed = check_array(X.iloc[:, inputs], dtype=AS_GIVEN, ensure_all_finite=False)
        unfed = rows_of_runs(layout, empty_runs(layout, needed, list(range(len(inputs)))))
        control = ControlCheck()
        if choice.lost_control != KEEP and choice.domain != "machine":
            control = control_check(layout, channels, scored_rows(layout, run_in, None))
        return cls(
            layout=layout,
            columns={role: str(X.columns[i]) for role, i in of_role.items()},
            channels=channels,
            output=y.mask(control.rows(layout.n_rows) | unfed),
            left_out=control.table,
            complete=not (X.isna().any(axis=None) or y.isna().any()),
        )

    @contextmanager
    def left_out_quietly(self) -> Iterator[None]:
        """Warn of no missing output where all that is missing was left out."""
        with warnings.catch_warnings():
            if self.complete:
                warnings.simplefilter("ignore", MissingDataWarning)
            yield

    def leak(
        self, model: Any, prediction: np.ndarray, keep: np.ndarray, least: LeastDelay
    ) -> LeakTest | None:
        """The leak test of a free run, in the rows to keep; None where it cannot know x."""
        if not least.loop:  # what comes from outside the loop alone tells nothing of x
            return None
        return leak_test(
            np.where(keep, self.output.to_numpy(dtype=float), np.nan),
            prediction,
            self.channels,
            self.layout.dt,
            [slice(*rows) for rows in pairwise(self.layout.stretches)],
            told=lambda role: self.columns[role] in model.inputs_,
            least_delay=LEAST_DELAY if least.domain == "human" else model.dt_,
            most=SLOPE_OF_X if least.closed else SLOPE,
            opposed=OPPOSED,
        )


def _note_worse(models: list[FittedModel]) -> list[Note]:
    """Why the model explains less of the held-out rows, or less than the one without its delay."""
    first, last = models[0], models[-1]
    if last.verdict is Verdict.WORSE:
        text = (
            "the held-out rows differ from those fitted, or the model is too simple for them: "
            f"{len(last.model.parameter_names_)} parameters cannot have learnt that much noise"
        )
        return [Note("worse", text)]
    if len(models) < 2 or last.vaf_validation > first.vaf_validation - WORSE_BY:
        return []
    text = (
        f"{last.name!r} explains less of the held-out rows than {first.name!r} "
        f"({last.vaf_validation:.1f} and {first.vaf_validation:.1f} %): delay and orders are those "
        "of the fitted rows, and the delay that of the lowest one-step error, which is not that of "
        "the best free run"
    )
    return [Note("worse", text)]


def _leak_notes(model: FittedModel, least: LeastDelay) -> list[Note]:
    """Why a model is refused, and what to do."""
    if not (model.leaks or model.untold):
        return []
    seen = "Leaks can be tested where two of e, x and f_t are known."
    if model.leak is not None:
        seen = model.leak.reason
    delay = max(_loop_delay(model.model, least) * model.model.dt_, least.seconds)
    verdict = f"it {Verdict.REBUILDS if model.leaks else Verdict.UNTOLD}"
    return [
        Note(
            "leak",
            f"The model {model.name!r} is no answer: {verdict}. {seen} Give a least delay that is "
            f"longer than {delay:.3g} s, or other inputs: e alone, or f_t without e and x.",
        )
    ]


def _loop_delay(model: Any, least: LeastDelay) -> int:
    """Shortest delay, in samples, of the inputs that the output moves."""
    names = [str(name) for name in least.loop]
    of_inputs = zip(model.inputs_, model.orders_.nk, strict=True)
    return min(nk for name, nk in of_inputs if name in names)


def _spare(model: Any, least: LeastDelay) -> float:
    """By how many samples a person answers later than at the least, where the inputs tell x."""
    if not least.closed or least.domain != "human":
        return np.inf
    return float(_loop_delay(model, least) - least.samples)


def _held_out_rows(
    layout: RunLayout, validation_runs: list[Any] | None, run_in: float
) -> tuple[np.ndarray, tuple[str, str]]:
    """Mark the validation rows, and describe both parts in text; halves are of what is kept."""
    run = layout.run_of(np.arange(layout.n_rows))
    labels = layout.labels
    if validation_runs is None and len(labels) == 1:
        begun = int(np.searchsorted(layout.time - layout.time[0], run_in))
        middle = min((begun + layout.n_rows + 1) // 2, layout.n_rows - 1)
        half = layout.time[middle] - layout.time[0]
        return np.arange(layout.n_rows) >= middle, (
            f"run {labels[0]!r}, {f'{run_in:g} to' if begun else 'first'} {half:.4g} s",
            f"run {labels[0]!r}, after {half:.4g} s",
        )
    names = [run_name(label) for label in labels]
    wanted = [str(w) for w in validation_runs] if validation_runs else [names[-1]]
    unknown = [w for w in wanted if w not in names]
    if unknown:
        raise ValueError(f"There is no run {unknown[0]!r} to validate on; the runs are {names}.")
    chosen = np.isin(names, wanted)
    if chosen.all():
        raise ValueError("Every run is held out for validation; leave at least one to fit on.")

    def listed(mask: np.ndarray) -> str:
        some = [repr(name) for name, m in zip(names, mask, strict=True) if m]
        return ("run " if len(some) == 1 else f"{len(some)} runs: ") + ", ".join(some)

    return chosen[run], (listed(~chosen), listed(chosen))
