"""Findings of a comparison: what its tests mean, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..effects.composition import Effects
from ..effects.registry import title_of
from ..interpret.arx_channel import is_arx
from ..model.operator_regressor import OperatorRegressor
from ..pipelines import taken_apart
from ..preprocessing import DelayShift
from ..preprocessing.base import as_fitted
from ..recordings.recording import Finding
from ..runs.roles import is_external, role_of
from ..text import counted, gap_text, p_text, vaf_name
from .ceiling import Route
from .leaks import band_edge
from .signals import Signals

if TYPE_CHECKING:
    from .comparison import Comparison


@dataclass(frozen=True)
class Words:
    """Meanings of findings, one for each kind."""

    lost_control: str
    outlying_run: str
    learning: str
    bias: str
    level: str
    outlier: str
    change: str
    power_change: str
    mean_change: str
    range: str
    asymmetry: str
    follows_target: str
    follows_disturbance: str


WORDS = {
    "human": Words(
        lost_control="A person who has lost control no longer responds as before.",
        outlying_run="Another person, a practice run, fatigue, or a setting that was changed.",
        learning="The person is still learning (falling) or tiring (growing) from run to run.",
        bias="An offset of the recording, a trim of the stick, or integral action.",
        level="A stop of the stick, a limit of the recording, or a level the person returns to.",
        outlier="A slip of the hand, a spike or a gap of the recording, or an onset that the "
        "model does not have.",
        change="The person's parameters change within the run; the model's do not, or not as much.",
        power_change="Effort or workload change, or the remnant's gain follows the person's own.",
        mean_change="A bias that drifts or steps: posture, trim, or an offset of the recording.",
        range="check the stick's range",
        asymmetry="Left and right differ: the arm, the stick, or an offset.",
        follows_target="On a pursuit or preview display: feedforward from the target. On a "
        "compensatory display the person does not see the target, so it can only be precognition, "
        "a linear misfit of the response to e, or something equivalent to it.",
        follows_disturbance="The person, or the stick, responds to the disturbance along a path "
        "that does not go through e: motion, force, or vibration.",
    ),
    "machine": Words(
        lost_control="Beyond a stop or a limit, or after a fault, it no longer responds as before.",
        outlying_run="Another setting, load or temperature, a fault, or another initial state.",
        learning="It warms up, wears, or drifts from run to run.",
        bias="An offset of the recording or the actuator, a constant load, or integral action.",
        level="A stop, a limit of the actuator or of the recording, or a level at which it rests.",
        outlier="A shock, a spike or a gap of the recording, or an onset that the model does not "
        "have.",
        change="Gain or dynamics change within the run; the model's do not, or not as much.",
        power_change="The noise depends on time or on the operating point.",
        mean_change="A load or an offset that drifts or steps.",
        range="check the range of actuator and sensor",
        asymmetry="The two directions differ: friction, geometry, or an offset.",
        follows_target="Feedforward from the reference, or a linear misfit of the response to the "
        "input.",
        follows_disturbance="The disturbance acts on the output along a path that the model lacks.",
    ),
}


def is_operator(model: Any) -> bool:
    """Whether a model, or what a pipeline or search ends in, is an operator's."""
    return isinstance(taken_apart(model)[1], OperatorRegressor)


class NextSteps:
    """Steps to take with a model, or a pipeline or search that ends in one."""

    def __init__(self, model: Any):
        self._before, self._model = taken_apart(model)
        self._operator = isinstance(self._model, OperatorRegressor)
        self._arx = is_arx(self._model)
        self._told = as_fitted(self._model)
        effects = getattr(self._model, "effects_", getattr(self._told, "effects", None))
        self._effects = {effect.name for _, effect in Effects.of(effects)}

    @property
    def n_parameters(self) -> int | None:
        """Constant parameters of the model; None where they vary or are not known."""
        if hasattr(self._model, "coef_path_"):
            return None
        for name in ("parameters_", "coef_"):
            found = getattr(self._model, name, None)
            if found is not None:
                return len(found) if name == "parameters_" else int(np.size(found))
        return None

    @property
    def from_outside(self) -> bool:
        """Whether the model has inputs from outside the loop alone: it cannot know x."""
        inputs = getattr(self._model, "inputs_", [])
        roles = getattr(self._told, "roles", None)
        plain = (self._arx or self._operator) and not self._effects and len(inputs) > 0
        return plain and all(is_external(role_of(name, roles)) for name in inputs)

    def is_told(self, signal: str) -> bool:
        """Whether the model has a signal from outside the loop as an input."""
        inputs = self._inputs()
        all_columns = self._arx and not inputs and signal in getattr(self._model, "inputs_", [])
        return bool(self._has("disturbance")) or signal in inputs or all_columns

    def _has(self, *effects: str) -> str:
        """Name of the first of these effects that the model has, in words; else empty."""
        return next((title_of(name) for name in effects if name in self._effects), "")

    def _refit(self, name: str) -> str:
        return (
            f"The model already has the effect {name}: fit it on runs of the same condition, or "
            "search what else is missing (EffectSearchCV)."
        )

    def delay(self, seconds: float) -> str:
        """For a delay that should be some seconds longer, or shorter where negative."""
        if self._operator:
            return self._delay_of_operator()
        if not self._arx:
            more = "more" if seconds > 0 else "less"
            return f"Delay the inputs of the model {abs(seconds):.2g} s {more}."
        if seconds > 0:
            return "Search the delay again (DelaySearchCV), or shift by as much with DelayShift."
        if any(isinstance(step, DelayShift) and step.delay_ for step in self._before):
            return "Shift that much less with DelayShift, or search the delay with DelaySearchCV."
        samples = round(-seconds / self._model.dt_)
        if 0 < samples <= min(self._model.orders_.nk):
            return f"Lower nk by {counted(samples, 'sample')}, or search it with DelaySearchCV."
        return "Search the delay again with DelaySearchCV."

    def _delay_of_operator(self) -> str:
        delay = self._told.delay
        if delay is not None and "wrong_delay" not in self._effects:
            return (
                f"Free the delay, which was given as {delay:g} s: delay=None, or "
                '.with_effect("wrong_delay").'
            )
        return (
            "The model estimates its delay: fit it on runs of the same condition, or search what "
            "else is missing (EffectSearchCV)."
        )

    def leak(self) -> str:
        """For a model that rebuilds the output from what it caused."""
        what = "nk" if self._arx else "the delay"
        return (
            f"Give every path from e, x and f_t a least delay ({what}), or leave x out; judge "
            "by simulating the closed loop."
        )

    def lag(self, seconds: float) -> str:
        """For a response that should be later, or earlier, by its delay or by its dynamics."""
        if self._arx:
            step = "Search the delay (DelaySearchCV) and the orders again;"
        elif self._operator:
            step = self._delay_of_operator().removesuffix(".") + ";"
        else:
            step = self.delay(seconds).removesuffix(".") + ", or change its dynamics;"
        return f"{step} compare with Fourier coefficients."

    def bias(self) -> str:
        if name := self._has("bias"):
            return self._refit(name)
        if getattr(self._told, "fit_intercept", False):
            return (
                "The model has an intercept already: fit it on runs of the same condition, or "
                "subtract the mean of each run from X and y."
            )
        if self._operator:
            first = 'Add it, .with_effect("bias"), or s'
        else:
            first = "fit_intercept=True, or s" if hasattr(self._model, "fit_intercept") else "S"
        return f"{first}ubtract the mean of each run from X and y."

    def level(self) -> str:
        """For an output that stays at a level."""
        if name := self._has("saturation"):
            return self._refit(name)
        return (
            "Add a saturation at this level, or record with a wider range; free runs of a linear "
            "model go beyond it."
        )

    def change(self) -> str:
        """For a response that changes within the run."""
        if name := self._has("tv_gain", "gain_drift", "scheduled_gain", "tv_delay"):
            return self._refit(name)
        if hasattr(self._model, "coef_path_"):
            return "Use a shorter memory horizon (RecursiveARXCV finds it)."
        return (
            "Use RecursiveARX (memory_horizon by RecursiveARXCV), or a gain that varies over time."
        )

    def drift(self) -> str:
        """For a mean that changes within the run."""
        if name := self._has("drift"):
            return self._refit(name)
        return "Add a drift, or subtract the mean of each run from X and y."

    def nonlinearity(self, harder: bool, range_: str) -> str:
        """For a response that is weaker at small amplitudes (``harder``), or at large ones."""
        if harder:
            if name := self._has("dead_zone", "cubic_gain"):
                return self._refit(name)
            return "Add a dead zone on the error, or an amplitude-dependent gain."
        if name := self._has("saturation", "rate_limit", "cubic_gain"):
            return self._refit(name)
        return f"Add a saturation, or an amplitude-dependent gain; {range_}."

    def asymmetry(self) -> str:
        """For a response that is stronger to one sign."""
        if name := self._has("asym_gain", "rectified"):
            return self._refit(name)
        return "Add a gain for each sign" + ("." if self._has("bias") else ", or a bias.")

    def follow(self, signal: str) -> str:
        """For a residual that follows a signal from outside the loop."""
        known = ("feedforward", "preview") if signal == "f_t" else ("disturbance",)
        if name := self._has(*known):
            return self._refit(name)
        if signal in self._inputs():
            return f"{signal!r} is an input already: give it another delay or orders of its own."
        if signal != "f_t":
            if self._operator:
                return 'Add it, .with_effect("disturbance").'
            return f"Add {signal!r} as an input."
        if self._operator:
            if self._has("extra_lead"):
                return 'Add .with_effect("feedforward") on a pursuit display.'
            return 'Add .with_effect("feedforward") on a pursuit display, otherwise "extra_lead".'
        return (
            "On a pursuit display, add the target as an input, inputs=['e', 'f_t']; otherwise a "
            "lead."
        )

    def _inputs(self) -> list[Any]:
        inputs = getattr(self._told, "inputs", None)
        return [inputs] if isinstance(inputs, str) else list(inputs or [])

    def overfit(self, could: bool = True) -> str:
        if not could:
            return "Compare the runs (by_run), and fit on some of each condition."
        longer = ", or a longer memory horizon" if hasattr(self._model, "coef_path_") else ""
        return f"Fewer parameters{longer}."

    def unknown(self) -> str:
        search = (
            "search the orders (OrderSearchCV)"
            if self._arx
            else "search the effects (EffectSearchCV)"
        )
        return f"Look at the response over frequency; {search}."


REMARKS = ("first samples", "jitter", "constant channel", "missing samples", "clock jitter", "gaps")
SMALL = 0.05  # VAF points; what costs less is not worth a sentence
MAYBE_MISFIT = (
    "Without a noise ceiling it may as well be misfit: a gain or dynamics that change, or an "
    "effect that acts in part of the run."
)
GOOD_ONE_STEP, POOR = 95.0, 50.0  # percent; a model that only one-step predictions flatter


def advise(c: Comparison, signals: Signals, of_channels: list[Finding]) -> list[Finding]:
    """Ordered findings: first what makes the data doubtful, then what costs most.

    A finding's p is below the false-alarm rate over the number of tests: all together keep that
    rate.
    """
    found = [finding for finding in of_channels if finding.name not in REMARKS]
    then = NextSteps(signals.model)
    words = WORDS[c.domain]
    tests = c.tests[c.tests["valid"]]
    limit = c.false_alarm / max(int(tests["p"].notna().sum()), 1)
    certain = tests[(tests["p"] < limit) | (tests["exceeds"] & tests["p"].isna())]
    sure = {(t.test, t.signal): t for t in certain.itertuples()}
    if c.leak is not None and c.leak.leaks:
        found.append(
            Finding(
                "leak",
                "The model rebuilds the output from x instead of predicting it",
                c.leak.reason,
                "x is a function of the output: with hardly any delay between them, the inverse "
                "of the controlled element returns the output. The VAF of such a model says "
                "nothing.",
                then.leak(),
                "correlation",
            )
        )
    found += _runs(c, sure, words)
    least = SMALL / c.point_scale
    located = [f for f in _effects(c, sure, then, words) if not f.severity < least]
    located.sort(key=lambda f: -np.nan_to_num(f.severity, nan=0.0))
    found += located
    found += _model(c, signals, then)
    named = sum(np.nan_to_num(f.severity) for f in located)
    found += _not_located(c, sure, named, bool(located), then)
    found += [finding for finding in of_channels if finding.name in REMARKS]
    found += _design(c, signals)
    return [replace(f, severity=c.point_scale * f.severity) for f in found]


def _p(test: Any) -> str:
    return p_text(test.p)


def _points(c: Comparison, value: float) -> str:
    about = " (about the mean)" if c.mean_dominates else ""
    return f"{c.point_scale * value:.1f} VAF points{about}"


def _runs(c: Comparison, sure: dict[Any, Any], words: Words) -> Iterator[Finding]:
    for (name, run), test in sure.items():
        if name == "lost control":
            yield Finding(
                "lost control",
                f"In run {run} control was lost at about {test.where:.4g} s",
                f"For 4 s or more the error is {test.size:.1f} times its usual size in these runs.",
                words.lost_control,
                "Leave the stretch out of estimation and validation. EffectSearchCV and skhoid "
                "identify do so.",
                "runs",
            )
        if name == "outlying run":
            yield Finding(
                "outlying run",
                f"Run {run} is unlike the others: {test.size:.2f} times their residual power",
                f"{_p(test)}, given how much remnant of this spectrum scatters between runs.",
                words.outlying_run,
                "Look at its traces. Validate with and without it.",
                "runs",
            )
        if name == "learning" and "outlying run" not in {other for other, _ in sure}:
            more = "grows" if test.size > 0 else "falls"
            yield Finding(
                "learning",
                f"The residual power {more} by {abs(test.size):.0f} % per run",
                f"Trend of its logarithm over the runs, {_p(test)}.",
                words.learning,
                "Fit the last runs only, select_runs(X, y, last=5), or compare first and last.",
                "runs",
            )


def _effects(
    c: Comparison, sure: dict[Any, Any], then: NextSteps, words: Words
) -> Iterator[Finding]:
    yield from _response(c, sure, then)
    yield from _in_time(c, sure, then, words)
    bias = sure.get(("bias", c.output))
    if bias is not None:
        yield Finding(
            "bias",
            f"The measured output is offset from the simulation by {bias.size:+.3g}{_unit(c)}",
            f"Mean residual, {_p(bias)}; it costs {_points(c, bias.cost)}.",
            words.bias,
            then.bias(),
            "amplitude",
            bias.cost,
        )
    yield from _over_amplitude(c, sure, then, words)
    # Distortion is what a nonlinearity or a change in time leaves: it is reported once.
    causes = ("gain change", "nonlinearity", "asymmetry")
    reported = max((t.cost for (name, _), t in sure.items() if name in causes), default=0.0)
    for (name, signal), test in sure.items():
        if name == "cross-correlation":
            yield _follows(c, test, signal, sure, then, words)
        if name == "distortion" and test.cost > 2 * reported:
            yield _distorted(c, test, signal)
        if name == "level":
            yield Finding(
                "level",
                f"{100 * test.size:.1f} % of the samples sit {test.description}",
                f"{_p(test)}; neighbouring levels hold far fewer.",
                words.level,
                then.level(),
                "amplitude",
            )
        if name == "outlier":
            yield Finding(
                "outlier",
                f"A single event in run {signal} at {test.where:.4g} s: {test.size:.0f} standard "
                "deviations",
                f"Largest whitened residual; {_p(test)} if the remnant is normal.",
                words.outlier,
                "Look at the traces there; set wrong samples to NaN (they are then left out).",
                "time",
            )


def _distorted(c: Comparison, test: Any, signal: str) -> Finding:
    odd = " of odd order, such as a cubic gain or stiffness, a dead zone, saturation"
    order = {
        "odd lines": odd,
        "odd harmonics": odd,
        "even harmonics": " of even order: asymmetry, rectification, an offset before a gain",
    }.get(signal, ", or a response that varies in time")
    where = "between the excited lines" if signal == "between lines" else f"at the {signal}"
    return Finding(
        "distortion",
        f"The residual contains distortion {where}",
        f"{test.size:.3g} times the power of the noise there, {_p(test)}; {_points(c, test.cost)}.",
        f"A nonlinearity{order}. No linear model can produce it.",
        "Look at the amplitude view for its shape; add the nonlinearity.",
        "frequency",
        test.cost,
    )


def _response(c: Comparison, sure: dict[Any, Any], then: NextSteps) -> Iterator[Finding]:
    delay, lag = sure.get(("delay", c.output)), sure.get(("lag", c.output))
    if delay is not None and not delay.cost > 0:
        delay = None  # with that delay the response fits no better than the model does
    gain = sure.get(("gain", c.output))
    if delay is not None and not (lag is not None and delay.size * lag.size < 0):
        samples = counted(round(abs(delay.size) / c.dt), "sample")
        longer = "longer" if delay.size > 0 else "shorter"
        yield Finding(
            "delay",
            f"The delay is {abs(delay.size):.2g} s {longer} than the model's",
            f"Best delay {delay.where:.2g} s, with gain, lead and two lags free; off by "
            f"{samples}, {_p(delay)}; a response of that form with this delay gains "
            f"{_points(c, delay.cost)}.",
            "The delay of the model is wrong, however much its lags make up for it.",
            then.delay(delay.size),
            "frequency",
            delay.cost if lag is None else max(delay.cost, lag.cost),
        )
    if lag is not None and not (delay is not None and delay.size * lag.size > 0):
        later = "later" if lag.size > 0 else "earlier"
        yield Finding(
            "lag",
            f"The measured response is {abs(lag.size):.2g} s {later} than the simulated one",
            f"{_p(lag)}; it costs about {_points(c, lag.cost)}.",
            "The delay of the model is wrong, or its lag or lead: a fit biased by remnant in the "
            "loop does that too.",
            then.lag(lag.size),
            "frequency",
            lag.cost,
        )
    if gain is not None:
        more = "larger" if gain.size > 0 else "smaller"
        yield Finding(
            "gain",
            f"The measured response is {100 * abs(gain.size):.0f} % {more} than the simulated one",
            f"{_p(gain)}; it costs about {_points(c, gain.cost)}.",
            "The gain differs from that of the runs used for the fit, or the fit is biased by "
            "remnant in the loop or by a short memory.",
            "Fit on runs of the same condition; compare with Fourier coefficients or instruments "
            '(ARXRegressor(method="iv")).',
            "frequency",
            gain.cost,
        )


def _in_time(
    c: Comparison, sure: dict[Any, Any], then: NextSteps, words: Words
) -> Iterator[Finding]:
    change = sure.get(("gain change", "residual"))
    if change is not None:
        more = "grows" if change.size > 0 else "falls"
        yield Finding(
            "gain change",
            f"The response {more} by {100 * abs(change.size):.0f} % at about {change.where:.3g} s",
            f"Largest of all single changes of gain and delay, {_p(change)} for the whole search; "
            f"it costs about {_points(c, change.cost)}.",
            words.change,
            then.change(),
            "time",
            change.cost,
        )
    power = sure.get(("remnant power change", "residual"))
    if power is not None:
        known = c.ceiling.route is not Route.NONE
        yield Finding(
            "remnant power change",
            f"The {'remnant' if known else 'residual'}'s power changes by a factor of "
            f"{1 + power.size:.2g} at about {power.where:.3g} s",
            f"Largest of all single changes, {_p(power)} for the whole search.",
            words.power_change + ("" if known else " " + MAYBE_MISFIT),
            "Weight the parts of the run by it, or fit them separately; check the response there.",
            "map",
        )
    mean = sure.get(("mean change", "residual"))
    if mean is not None:
        yield Finding(
            "mean change",
            f"The mean residual changes at about {mean.where:.3g} s",
            f"By {mean.size:.3g}{_unit(c)}; {_p(mean)} for the whole search.",
            words.mean_change,
            then.drift(),
            "time",
        )


def _over_amplitude(
    c: Comparison, sure: dict[Any, Any], then: NextSteps, words: Words
) -> Iterator[Finding]:
    shaped = [t for (name, _), t in sure.items() if name == "nonlinearity"]
    asymmetric = [t for (name, _), t in sure.items() if name == "asymmetry"]
    # What one sign does more than the other is no straight line either: it is reported once.
    one_sided = {t.signal: t.statistic for t in asymmetric}
    shaped = [t for t in shaped if t.statistic > 2 * one_sided.get(t.signal, 0.0)]
    if shaped and not (asymmetric and max(one_sided.values()) > max(t.statistic for t in shaped)):
        # A static nonlinearity shows over all signals that go with the one that it acts on.
        best = max(shaped, key=lambda t: t.statistic)
        others = [t.signal for t in shaped if t is not best]
        harder = _curvature(c.by_operating_point, best.signal) > 0
        also = f" (also over {', '.join(others)})" if others else ""
        if harder:
            title = f"The response is weaker at small {best.signal} than at large {best.signal}"
            meaning = "An indifference threshold (dead zone), or a gain that grows with amplitude."
        else:
            title = f"The response is weaker at large {best.signal} than at small {best.signal}"
            meaning = "Saturation or a rate limit of the output, or a gain that falls with size."
        yield Finding(
            "nonlinearity",
            title,
            f"Mean residual over {best.signal}{also} against a straight line, {_p(best)}; it costs "
            f"at least {_points(c, best.cost)}.",
            meaning,
            then.nonlinearity(harder, words.range),
            "amplitude",
            best.cost,
        )
    if asymmetric:
        best = max(asymmetric, key=lambda t: t.statistic)
        side = "positive" if best.size > 0 else "negative"
        yield Finding(
            "asymmetry",
            f"The response to {side} {best.signal} is stronger",
            f"Mean residual over {best.signal}: the part that does not change sign with it, "
            f"{_p(best)}.",
            words.asymmetry,
            then.asymmetry(),
            "amplitude",
            best.cost,
        )


def _curvature(table: pd.DataFrame, channel: str) -> float:
    """Sign of the cubic part of the mean residual, of the sign of the response."""
    own = table[table["channel"] == channel]
    z = own["center"].to_numpy() / max(float(own["center"].abs().max()), 1e-300)
    design = np.column_stack([np.ones(z.size), z, z**2, z**3])
    weight = np.sqrt(own["count"].to_numpy())
    cubic = np.linalg.lstsq(design * weight[:, None], own["mean"] * weight, rcond=None)[0][3]
    return float(cubic * own["sign"].iloc[0])


def _follows(
    c: Comparison, test: Any, signal: str, sure: dict[Any, Any], then: NextSteps, words: Words
) -> Finding:
    lag = test.where
    when = f"{abs(lag):.2g} s " + ("after" if lag >= 0 else "before")
    linear = [name for name in ("gain", "lag", "delay", "bias") if (name, c.output) in sure]
    also = f" A wrong {' and '.join(linear)} (see there) shows here as well." if linear else ""
    meaning = (words.follows_target if signal == "f_t" else words.follows_disturbance) + also
    return Finding(
        "cross-correlation",
        f"The residual follows {signal}: most {when} it",
        f"Prewhitened correlation {test.size:+.2f} at that lag, {_p(test)} over all lags. "
        f"{signal} comes from outside the loop, so remnant cannot cause it.",
        meaning,
        then.follow(signal),
        "correlation",
        max(test.cost - sum(sure[name, c.output].cost for name in linear), 0.0),
    )


def _model(c: Comparison, signals: Signals, then: NextSteps) -> Iterator[Finding]:
    if c.overfit:
        could, meaning = _overfit(c, signals, then)
        yield Finding(
            "overfit",
            f"{'Overfit: the' if could else 'The'} error on validation runs is "
            f"{c.overfit_ratio:.2f} times that on estimation runs",
            f"VAF {c.estimation_vaf:.1f} % on estimation runs, {c.vaf:.1f} % on validation runs; "
            "the limit is 1.1.",
            meaning,
            then.overfit(could),
            "runs",
        )
    if c.one_step_vaf > GOOD_ONE_STEP and c.vaf < POOR:
        yield Finding(
            "one step only",
            f"Good one step ahead ({c.one_step_vaf:.1f} %), poor as a free run ({c.vaf:.1f} %)",
            "VAF of the same runs.",
            "The next sample is close to the last one, whatever the model. Only a free run shows "
            "whether it has the response.",
            "Judge by the free run; lower the sampling rate (Decimator), or search the orders.",
            "overview",
        )


def _overfit(c: Comparison, signals: Signals, then: NextSteps) -> tuple[bool, str]:
    """Whether the parameters can have learnt the noise, and what a higher error means.

    p parameters fitted to N independent values raise the error of other runs by (N + p)/(N - p); N
    is twice the bandwidth of the output times the duration.
    """
    differ = "These runs differ from those the model was fitted to"
    either = f"The model has learnt the noise of its own runs, or {differ[0].lower()}{differ[1:]}."
    if then.n_parameters is None:
        return True, either
    p = then.n_parameters
    seconds = float(c.by_run.loc[c.by_run["data"] == "estimation", "duration"].sum())
    outputs = [signals.y[rows[0] : rows[-1] + 1] for g in signals.groups for rows in g.rows]
    n = 2 * band_edge(outputs, c.dt, 0.9) * seconds
    learnt = 2 * p / (n - p) if n > p else np.inf
    if learnt > (c.overfit_ratio - 1) / 2:
        return True, either
    return False, (
        f"{differ}: {counted(p, 'parameter')} cannot have learnt that much noise from "
        f"{seconds:.4g} s of data."
    )


def _not_located(
    c: Comparison, sure: dict[Any, Any], named: float, any_located: bool, then: NextSteps
) -> Iterator[Finding]:
    gap = sure.get(("explainable gap", "residual"))
    several = bool(c.by_frequency["exceeds"].any() or c.by_time["exceeds"].any())
    if gap is not None and c.point_scale * gap.cost > SMALL and named < gap.cost / 2:
        what = "the findings above do not account for" if any_located else "no test locates"
        yield Finding(
            "unknown",
            f"{_points(c, gap.cost - named)} are left to explain that {what}",
            f"The residual repeats with the target, {_p(gap)}: {_both(c)}.",
            "Several small misfits (order, lag, second mode), or an effect that these views do "
            "not separate.",
            then.unknown(),
            "frequency",
            gap.cost,
        )
    elif not any_located and not sure and not several and c.ceiling.route is not Route.NONE:
        yield Finding(
            "none",
            "Nothing is missing that these runs could show",
            f"No test exceeds chance when all are counted. {_both(c)}; left to explain: "
            f"{gap_text(c.point_scale * c.explainable_gap)}.",
            "What the model does not explain does not repeat: as far as these runs can tell, it "
            "is remnant.",
            "Stop here, or record more runs to see smaller effects.",
            "overview",
        )


def _design(c: Comparison, signals: Signals) -> Iterator[Finding]:
    if c.ceiling.route is Route.NONE:
        yield Finding(
            "no ceiling",
            "How much is left to explain is not known",
            f"There is no noise ceiling: {c.ceiling.note}.",
            "A low VAF may be due to remnant or to misfit: these runs cannot tell.",
            "Record runs that share the target and the disturbance, or a whole number of periods "
            "of a multisine.",
            "ceiling",
        )
    several = [group for group in signals.groups if group.n_runs > 1]
    if len(signals.groups) == 1 and several and "f_t" in signals.channels:
        yield Finding(
            "one target",
            "All runs share one forcing function",
            f"{several[0].n_runs} runs have the same target.",
            "Validation cannot separate what repeats with the target from what repeats with time.",
            "Record a second realisation of the target (make_tracking_runs(random_phases=True) "
            "shows how they differ).",
        )


def _both(c: Comparison) -> str:
    """VAF and noise ceiling with its interval."""
    low, high = (c.about_mean(edge) for edge in c.noise_ceiling_interval)
    name = vaf_name(centered=c.mean_dominates)
    return (
        f"{name} {c.about_mean(c.vaf):.1f} %, noise ceiling {c.about_mean(c.noise_ceiling):.1f} % "
        f"(95 % interval {low:.1f} to {high:.1f} %)"
    )


def _unit(c: Comparison) -> str:
    return f" {c.unit}" if c.unit else ""
