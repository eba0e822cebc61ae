"""Findings of a comparison: what its tests mean, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..arx.base import UNSTABLE
from ..effects.composition import Effects
from ..effects.registry import title_of
from ..interpret.arx_channel import is_arx
from ..model.operator_regressor import OperatorRegressor
from ..pipelines import taken_apart
from ..preprocessing.base import as_fitted
from ..recordings.recording import Finding
from ..runs.roles import is_external, role_of
from ..text import Step, ceiling_text, counted, gap_text, p_text, vaf_name
from .ceiling import Route
from .leaks import band_edge, can_have_learnt
from .signals import Signals

if TYPE_CHECKING:
    from .comparison import Comparison

# Meanings of findings: of a person, and of a machine where they differ.
WORDS = {
    "human": {
        "lost control": "A person who has lost control no longer responds as before.",
        "outlying run": "Another person, a practice run, fatigue, or a setting that was changed.",
        "learning": "The person is still learning (falling) or tiring (growing) from run to run.",
        "bias": "An offset of the recording, a trim of the stick, or integral action.",
        "level": "A stop of the stick, a limit of the recording, or a level the person returns to.",
        "outlier": "A spike or a gap of the recording, or a slip of the hand.",
        "gain change": "The person's parameters change within the run; the model's do not, or not "
        "as much.",
        "remnant power change": "Effort or workload change, or the remnant's gain follows the "
        "person's own.",
        "mean change": "A bias that drifts or steps: posture, trim, or an offset of the recording.",
        "asymmetry": "Left and right differ: the arm, the stick, or an offset.",
        "follows f_t": "On a pursuit or preview display: feedforward from the target. On a "
        "compensatory display the person does not see the target, so it can only be precognition, "
        "a linear misfit of the response to e, or something equivalent to it.",
        "follows dist": "The person, or the stick, responds to the disturbance along a path "
        "that does not go through e: motion, force, or vibration.",
    },
    "machine": {
        "lost control": "Beyond a stop or a limit, or after a fault, it no longer responds as "
        "before.",
        "outlying run": "Another setting, load or temperature, a fault, or another initial state.",
        "learning": "It warms up, wears, or drifts from run to run.",
        "bias": "An offset of the recording or the actuator, a constant load, or integral action.",
        "level": "A stop, a limit of the actuator or of the recording, or a level of rest.",
        "outlier": "A spike or a gap of the recording, or a shock.",
        "gain change": "Gain or dynamics change within the run; the model's do not, or not as "
        "much.",
        "remnant power change": "The noise depends on time or on the operating point.",
        "mean change": "A load or an offset that drifts or steps.",
        "asymmetry": "The two directions differ: friction, geometry, or an offset.",
        "follows f_t": "Feedforward from the reference, or a linear misfit of the response to the "
        "input.",
        "follows dist": "The disturbance acts on the output along a path that the model lacks.",
    },
}


class NextSteps:
    """Steps to take with a model, or a pipeline or search that ends in one."""

    def __init__(self, model: Any):
        self._model = taken_apart(model)[1]
        self.is_controller = getattr(self._model, "controller", None) is not None
        self.is_operator = isinstance(self._model, OperatorRegressor)
        self._arx = is_arx(self._model)
        self._told = as_fitted(self._model)
        effects = getattr(self._model, "effects_", getattr(self._told, "effects", None))
        self._effects = {effect.name for _, effect in Effects.of(effects)}
        inputs = getattr(self._told, "inputs", None)
        self._inputs = [inputs] if isinstance(inputs, str) else list(inputs or [])

    @property
    def n_parameters(self) -> int | None:
        """Constant parameters of the model; None where they vary or are not known."""
        if hasattr(self._model, "coef_path_"):
            return None
        found = getattr(self._model, "parameters_", None)
        if found is not None:
            return len(found)
        found = getattr(self._model, "coef_", None)
        return None if found is None else int(np.size(found))

    @property
    def from_outside(self) -> bool:
        """Whether the model has inputs from outside the loop alone: it cannot know x."""
        inputs = getattr(self._model, "inputs_", [])
        roles = getattr(self._told, "roles", None)
        plain = (self._arx or self.is_operator) and not self._effects and len(inputs) > 0
        return plain and all(is_external(role_of(name, roles)) for name in inputs)

    def is_told(self, signal: str) -> bool:
        """Whether the model has a signal from outside the loop as an input."""
        all_columns = self._arx and not self._inputs
        inputs = getattr(self._model, "inputs_", []) if all_columns else self._inputs
        return "disturbance" in self._effects or signal in inputs

    def _unless_it_has(self, effects: str, step: str, typed: str = "") -> Step:
        """A step, or another one where the model has one of these effects already."""
        name = next((title_of(name) for name in effects.split() if name in self._effects), "")
        if not name:
            return Step(step, typed)
        again = f"The model already has the effect {name}: fit it on runs of the same condition, or"
        return Step(f"{again} search what else is missing (EffectSearchCV).", f"{again} {ALL}.")

    def delay(self, seconds: float) -> Step:
        """For a delay that should be some seconds longer, or shorter where negative."""
        if self._arx:
            again = "Search the delay again"
            return Step(f"{again} (DelaySearchCV).", f"{again}: skhoid identify without --nk.")
        if not self.is_operator:
            more = "more" if seconds > 0 else "less"
            return Step(f"Delay the inputs of the model {abs(seconds):.2g} s {more}.")
        delay = self._told.delay
        if delay is not None and "wrong_delay" not in self._effects:
            free = f"Free the delay, which was given as {delay:g} s:"
            return Step(
                f'{free} delay=None, or .with_effect("wrong_delay").', f"{free} leave --delay out."
            )
        again = "The model estimates its delay: fit it on runs of the same condition, or"
        return Step(f"{again} search what else is missing (EffectSearchCV).", f"{again} {ALL}.")

    def leak(self) -> Step:
        """For a model that rebuilds the output from what it caused."""
        what, typed = ("nk", "--nk") if self._arx else ("the delay", "--delay")
        first = "Give every path from e, x and f_t a least delay"
        last = "or leave x out; judge by simulating the closed loop."
        return Step(f"{first} ({what}), {last}", f"{first} ({typed}), {last}")

    def bias(self) -> Step:
        means = "subtract the mean of each run from X and y"
        if getattr(self._told, "fit_intercept", False):
            again = "The model has an intercept already: fit it on runs of the same condition"
            return Step(f"{again}, or {means}.", f"{again}.")
        step, typed = f"{means[0].upper()}{means[1:]}.", ""
        if self.is_operator:
            step, typed = f'Add it, .with_effect("bias"), or {means}.', f"Add it: {SEARCH} bias."
        elif hasattr(self._model, "fit_intercept"):
            step, typed = f"fit_intercept=True, or {means}.", "Fit it without --keep-means."
        return self._unless_it_has("bias", step, typed)

    def level(self) -> Step:
        """For an output that stays at a level."""
        rest = "at this level, or record with a wider range; free runs of a linear model go beyond "
        return self._unless_it_has(
            "saturation",
            f"Add a saturation {rest}it.",
            f"Add a saturation ({SEARCH} saturation) {rest}it.",
        )

    def change(self) -> Step:
        """For a response that changes within the run."""
        step = "Use a shorter memory horizon (RecursiveARXCV finds it)."
        typed = "Use a shorter memory: skhoid identify --memory-time S."
        if not hasattr(self._model, "coef_path_"):
            step = (
                "Use RecursiveARX (memory_horizon by RecursiveARXCV), or a gain that varies over "
                "time."
            )
            typed = "Follow the change (skhoid identify --memory-time S), or let the gain vary "
            typed += f"over time: {SEARCH} tv_gain."
        return self._unless_it_has("tv_gain gain_drift scheduled_gain tv_delay", step, typed)

    def drift(self) -> Step:
        """For a mean that changes within the run."""
        step = "Add a drift, or subtract the mean of each run from X and y."
        return self._unless_it_has("drift", step, f"Add a drift: {SEARCH} drift.")

    def nonlinearity(self, harder: bool) -> Step:
        """For a response that is weaker at small amplitudes (``harder``), or at large ones."""
        if harder:
            step = "Add a dead zone on the error, or an amplitude-dependent gain"
            return self._unless_it_has(
                "dead_zone cubic_gain", f"{step}.", f"{step}: {SEARCH} dead_zone cubic_gain."
            )
        step, last = "Add a saturation, or an amplitude-dependent gain", "check the range recorded."
        return self._unless_it_has(
            "saturation rate_limit cubic_gain",
            f"{step}; {last}",
            f"{step} ({SEARCH} saturation cubic_gain); {last}",
        )

    def asymmetry(self) -> Step:
        """For a response that is stronger to one sign."""
        step = "Add a gain for each sign, or a bias"
        return self._unless_it_has(
            "asym_gain rectified", f"{step}.", f"{step}: {SEARCH} asym_gain bias."
        )

    def follow(self, signal: str) -> Step:
        """For a residual that follows a signal from outside the loop."""
        typed = ""
        if signal in self._inputs:
            step = f"{signal!r} is an input already: give it another delay or orders of its own."
        elif signal != "f_t":
            step = f"Add {signal!r} as an input."
            typed = f"Add {signal!r} as an input of skhoid identify."
            if self.is_operator:
                step = 'Add it, .with_effect("disturbance").'
                typed = f"Add it: {SEARCH} disturbance."
        elif self.is_operator:
            step = 'Add .with_effect("feedforward") on a pursuit display, otherwise "extra_lead".'
            typed = f"On a pursuit display: {SEARCH} feedforward; otherwise {SEARCH} extra_lead."
        else:
            step = (
                "On a pursuit display, add the target as an input, inputs=['e', 'f_t']; otherwise "
                "a lead."
            )
            typed = "On a pursuit display, add the target as an input: skhoid identify --input e "
            typed += "f_t, by the names of your columns; otherwise a higher order (--nb)."
        known = "feedforward preview" if signal == "f_t" else "disturbance"
        return self._unless_it_has(known, step, typed)

    def overfit(self, could: bool = True) -> Step:
        if not could:
            last = "and fit on some of each condition."
            return Step(f"Compare the runs (by_run), {last}", f"Compare the runs above, {last}")
        longer = ", or a longer memory horizon" if hasattr(self._model, "coef_path_") else ""
        return Step(f"Fewer parameters{longer}.")

    def unknown(self) -> Step:
        look = "Look at the response over frequency; search the"
        if self._arx:
            return Step(f"{look} orders (OrderSearchCV).", f"{look} orders: skhoid identify.")
        return Step(f"{look} effects (EffectSearchCV).", f"{look} effects: skhoid diagnose.")


# How one searches at the command line: for some effects, and for all.
SEARCH = "skhoid diagnose --effects"
ALL = "search what else is missing (skhoid diagnose)"
REMARKS = ("first samples", "jitter", "constant channel", "missing samples", "clock jitter", "gaps")
# % of VAF about the mean: five parameters fitted to 100 rows explain as much by chance.
LEAST_EXPLAINED = 5.0
TENFOLD = 9.0  # relative change
SMALL = 0.05  # VAF points; what costs less is not worth a sentence
GOOD_ONE_STEP, POOR = 95.0, 50.0  # percent; a model that only one-step predictions flatter


def advise(c: Comparison, signals: Signals, of_channels: list[Finding]) -> list[Finding]:
    """Ordered findings: first what makes the data doubtful, then what costs most."""
    advice = Advice(c, signals)
    found = [finding for finding in of_channels if finding.name not in REMARKS]
    found += advice.doubts()
    located = [f for f in advice.effects() if not f.severity < SMALL / c.point_scale]
    located.sort(key=lambda f: -np.nan_to_num(f.severity, nan=0.0))
    named = sum(np.nan_to_num(f.severity) for f in located)
    found += [*located, *advice.of_model(), *advice.not_located(named, bool(located))]
    found += [finding for finding in of_channels if finding.name in REMARKS]
    found += advice.of_design()
    return [replace(f, severity=c.point_scale * f.severity) for f in found]


class Advice:
    """What the tests of a comparison that are surely beyond chance say."""

    def __init__(self, c: Comparison, signals: Signals):
        self.c, self.signals, self.then = c, signals, NextSteps(signals.model)
        self.words = WORDS[c.domain]
        tests = c.tests[c.tests["valid"]]
        # All findings together keep the false-alarm rate.
        limit = c.false_alarm / max(int(tests["p"].notna().sum()), 1)
        certain = tests[(tests["p"] < limit) | (tests["exceeds"] & tests["p"].isna())]
        self.sure: dict[Any, Any] = {(t.test, t.signal): t for t in certain.itertuples()}

    def _all(self, name: str) -> list[Any]:
        return [test for (of, _), test in self.sure.items() if of == name]

    def _points(self, value: float) -> str:
        about = " (about the mean)" if self.c.mean_dominates else ""
        return f"{self.c.point_scale * value:.1f} VAF points{about}"

    def doubts(self) -> Iterator[Finding]:
        """A model that is unstable, a leak, and runs unlike the others."""
        c = self.c
        if self.signals.growth > UNSTABLE:
            yield Finding(
                "unstable",
                "The model is unstable: its free run goes astray whatever the input",
                f"By its poles alone it grows by the power {self.signals.growth / np.log(10):.3g} "
                "of 10 over a run, and an integral does not grow.",
                "Its VAF tells how it was started and how long the runs are. It may fit one step "
                "ahead, as the measured output keeps such a prediction from going astray.",
                "Fit other orders or a longer delay; inputs that come later than the output (a "
                "clock that is shifted, a person who sees ahead) lead to such fits, too.",
                "traces",
            )
        if c.leak is not None and c.leak.leaks:
            yield Finding(
                "leak",
                "The model rebuilds the output from x instead of predicting it",
                c.leak.reason,
                "x is a function of the output: with hardly any delay between them, the inverse "
                "of the controlled element returns the output. The VAF of such a model says "
                "nothing.",
                self.then.leak(),
                "correlation",
            )
        for test in self._all("lost control"):
            yield Finding(
                "lost control",
                f"In run {test.signal} control was lost at about {test.where:.4g} s",
                f"For 4 s or more the error is {test.size:.1f} times its usual size in these runs.",
                self.words["lost control"],
                Step(
                    "Leave the stretch out of estimation and validation. EffectSearchCV and skhoid "
                    "identify do so.",
                    "Leave the stretch out of estimation and validation. skhoid diagnose and "
                    "identify do so.",
                ),
                "runs",
            )
        outlying = self._all("outlying run")
        for test in outlying:
            yield Finding(
                "outlying run",
                f"Run {test.signal} is unlike the others: {test.size:.2f} times their residual "
                "power",
                f"{p_text(test.p)}, given how much remnant of this spectrum scatters between runs.",
                self.words["outlying run"],
                "Look at its traces. Validate with and without it.",
                "runs",
            )
        for test in [] if outlying else self._all("learning"):
            more = "grows" if test.size > 0 else "falls"
            yield Finding(
                "learning",
                f"The residual power {more} by {abs(test.size):.0f} % per run",
                f"Trend of its logarithm over the runs, {p_text(test.p)}.",
                self.words["learning"],
                Step(
                    "Fit the last runs only, select_runs(X, y, last=5), or compare first and last.",
                    "Fit the last runs only, or compare first and last: name their files.",
                ),
                "runs",
            )

    def effects(self) -> Iterator[Finding]:
        """What the residual shows where it shows."""
        yield from self._response()
        yield from self._in_time()
        unit = f" {self.c.unit}" if self.c.unit else ""
        for bias in self._all("bias"):
            yield Finding(
                "bias",
                f"The measured output is offset from the simulation by {bias.size:+.3g}{unit}",
                f"Mean residual, {p_text(bias.p)}; it costs {self._points(bias.cost)}.",
                self.words["bias"],
                self.then.bias(),
                "amplitude",
                bias.cost,
            )
        yield from self._over_amplitude()
        for test in self._all("outlier"):
            yield Finding(
                "outlier",
                f"A single event in run {test.signal} at {test.where:.4g} s: {test.size:.0f} "
                "standard deviations",
                f"Largest whitened residual; {p_text(test.p)} if the remnant is normal.",
                self._singled_out(),
                Step(
                    "Look at the traces there; set wrong samples to NaN (they are then left out).",
                    "Look at the traces there; empty wrong samples of the output in the file (they "
                    "are then left out).",
                ),
                "time",
            )
        # Distortion is what a nonlinearity or a change in time leaves: it is reported once.
        causes = ("gain change", "nonlinearity", "asymmetry")
        reported = max((t.cost for name in causes for t in self._all(name)), default=0.0)
        for test in self._all("distortion"):
            if test.cost > 2 * reported:
                yield self._distorted(test)
        yield from map(self._follows, self._all("cross-correlation"))
        for test in self._all("level"):
            yield Finding(
                "level",
                f"{100 * test.size:.1f} % of the samples sit {test.description}",
                f"{p_text(test.p)}; neighbouring levels hold far fewer.",
                self.words["level"],
                self.then.level(),
                "amplitude",
            )

    def _singled_out(self) -> str:
        """What a single event may be; where the model lacks something, that first."""
        own, shown = self.words["outlier"], ("nonlinearity", "asymmetry", "distortion")
        if any(map(self._all, ("explainable gap", *shown))):
            return (
                "Perhaps the place where it costs most that the model lacks something, as the "
                f"other findings say: look for that first. If the event stays: {own[:1].lower()}"
                f"{own[1:]}"
            )
        if self.c.ceiling.route.separates:
            return own
        return (
            f"{own.rstrip('.')}; or something that the model does not have, such as an onset, a "
            "dead zone or a stop."
        )

    def _distorted(self, test: Any) -> Finding:
        odd = " of odd order, such as a cubic gain or stiffness, a dead zone, saturation"
        order = {
            "odd lines": odd,
            "odd harmonics": odd,
            "even harmonics": " of even order: asymmetry, rectification, an offset before a gain",
        }.get(test.signal, ", or a response that varies in time")
        between = test.signal == "between lines"
        where = "between the excited lines" if between else f"at the {test.signal}"
        return Finding(
            "distortion",
            f"The residual contains distortion {where}",
            f"{test.size:.3g} times the power of the noise there, {p_text(test.p)}; "
            f"{self._points(test.cost)}.",
            f"A nonlinearity{order}. No linear model can produce it.",
            "Look at the amplitude view for its shape; add the nonlinearity.",
            "frequency",
            test.cost,
        )

    def _response(self) -> Iterator[Finding]:
        c = self.c
        delay, lag, gain = (self.sure.get((name, c.output)) for name in ("delay", "lag", "gain"))
        if delay is not None and not delay.cost > 0:
            delay = None  # with that delay the response fits no better than the model does
        if delay is not None and not (lag is not None and delay.size * lag.size < 0):
            samples = counted(round(abs(delay.size) / c.dt), "sample")
            longer = "longer" if delay.size > 0 else "shorter"
            yield Finding(
                "delay",
                f"The delay is {abs(delay.size):.2g} s {longer} than the model's",
                f"Best delay {delay.where:.2g} s, with gain, lead and two lags free; off by "
                f"{samples}, {p_text(delay.p)}; a response of that form with this delay gains "
                f"{self._points(delay.cost)}.",
                "The delay of the model is wrong, however much its lags make up for it.",
                self.then.delay(delay.size),
                "frequency",
                delay.cost if lag is None else max(delay.cost, lag.cost),
            )
        if lag is not None and not (delay is not None and delay.size * lag.size > 0):
            later = "later" if lag.size > 0 else "earlier"
            yield Finding(
                "lag",
                f"The measured response is {abs(lag.size):.2g} s {later} than the simulated one",
                f"{p_text(lag.p)}; it costs about {self._points(lag.cost)}.",
                "The delay of the model is wrong, or its lag or lead: a fit biased by remnant in "
                "the loop does that too.",
                self.then.delay(lag.size),
                "frequency",
                lag.cost,
            )
        if gain is not None:
            more = "larger" if gain.size > 0 else "smaller"
            by = f"{100 * abs(gain.size):.0f} % {more} than" if self._explains else "unlike"
            yield Finding(
                "gain",
                f"The measured response is {by} the simulated one",
                f"{p_text(gain.p)}; it costs about {self._points(gain.cost)}.",
                "The gain differs from that of the runs used for the fit, or the fit is biased by "
                "remnant in the loop or by a short memory.",
                Step(
                    "Fit on runs of the same condition; compare with Fourier coefficients or "
                    'instruments (ARXRegressor(method="iv")).',
                    "Fit on runs of the same condition; compare with instruments: skhoid identify "
                    "--method iv.",
                ),
                "frequency",
                gain.cost,
            )

    @property
    def _explains(self) -> bool:
        """Whether the model explains so much that its response is something to be relative to."""
        return self.c.vaf_about_mean >= LEAST_EXPLAINED

    def _by(self, size: float, grows: str, falls: str) -> str:
        """How a response changes: no share of a response that is hardly there."""
        if not self._explains:
            return "changes"
        if size > TENFOLD:
            return f"{grows} more than tenfold"
        return f"{grows if size > 0 else falls} by {100 * abs(size):.0f} %"

    def _in_time(self) -> Iterator[Finding]:
        for change in self._all("gain change"):
            yield Finding(
                "gain change",
                f"The response {self._by(change.size, 'grows', 'falls')} at about "
                f"{change.where:.3g} s",
                f"Largest of all single changes of gain and delay, {p_text(change.p)} for the "
                f"whole search; it costs about {self._points(change.cost)}.",
                self.words["gain change"],
                self.then.change(),
                "time",
                change.cost,
            )
        for power in self._all("remnant power change"):
            known = self.c.ceiling.route.separates
            maybe = (
                " Without a noise ceiling it may as well be misfit: a gain or dynamics that "
                "change, or an effect that acts in part of the run."
            )
            yield Finding(
                "remnant power change",
                f"The {'remnant' if known else 'residual'}'s power changes by a factor of "
                f"{1 + power.size:.2g} at about {power.where:.3g} s",
                f"Largest of all single changes, {p_text(power.p)} for the whole search.",
                self.words["remnant power change"] + ("" if known else maybe),
                "Weight the parts of the run by it, or fit them separately; check the response "
                "there.",
                "map",
            )
        unit = f" {self.c.unit}" if self.c.unit else ""
        for mean in self._all("mean change"):
            yield Finding(
                "mean change",
                f"The mean residual changes at about {mean.where:.3g} s",
                f"By {mean.size:.3g}{unit}; {p_text(mean.p)} for the whole search.",
                self.words["mean change"],
                self.then.drift(),
                "time",
            )

    def _over_amplitude(self) -> Iterator[Finding]:
        asymmetric = self._all("asymmetry")
        # What one sign does more than the other is no straight line either: it is reported once.
        one_sided = {t.signal: t.statistic for t in asymmetric}
        shaped = self._all("nonlinearity")
        shaped = [t for t in shaped if t.statistic > 2 * one_sided.get(t.signal, 0.0)]
        if shaped and max(t.statistic for t in shaped) >= max(one_sided.values(), default=0.0):
            # A static nonlinearity shows over all signals that go with the one that it acts on.
            best = max(shaped, key=lambda t: t.statistic)
            others = [t.signal for t in shaped if t is not best]
            harder = curvature(self.c.by_operating_point, best.signal) > 0
            also = f" (also over {', '.join(others)})" if others else ""
            weak, strong = ("small", "large") if harder else ("large", "small")
            meaning = "Saturation or a rate limit of the output, or a gain that falls with size."
            if harder:
                meaning = "An indifference threshold (dead zone), or a gain that grows with size."
            yield Finding(
                "nonlinearity",
                f"The response is weaker at {weak} {best.signal} than at {strong} {best.signal}",
                f"Mean residual over {best.signal}{also} against a straight line, "
                f"{p_text(best.p)}; it costs at least {self._points(best.cost)}.",
                meaning,
                self.then.nonlinearity(harder),
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
                f"{p_text(best.p)}.",
                self.words["asymmetry"],
                self.then.asymmetry(),
                "amplitude",
                best.cost,
            )

    def _follows(self, test: Any) -> Finding:
        signal, lag = test.signal, test.where
        when = f"{abs(lag):.2g} s " + ("after" if lag >= 0 else "before")
        names = ("gain", "lag", "delay", "bias")
        linear = {n: t for n in names if (t := self.sure.get((n, self.c.output))) is not None}
        also = f" A wrong {' and '.join(linear)} (see there) shows here as well." if linear else ""
        return Finding(
            "cross-correlation",
            f"The residual follows {signal}: most {when} it",
            f"Prewhitened correlation {test.size:+.2f} at that lag, {p_text(test.p)} over all "
            f"lags. {signal} comes from outside the loop, so remnant cannot cause it.",
            self.words["follows f_t" if signal == "f_t" else "follows dist"] + also,
            self.then.follow(signal),
            "correlation",
            max(test.cost - sum(t.cost for t in linear.values()), 0.0),
        )

    def of_model(self) -> Iterator[Finding]:
        """What validation says of the model as a whole."""
        c = self.c
        if c.overfit:
            could, meaning = self._overfit()
            yield Finding(
                "overfit",
                f"{'Overfit: the' if could else 'The'} error on validation runs is "
                f"{c.overfit_ratio:.2f} times that on estimation runs",
                f"VAF {c.estimation_vaf:.1f} % on estimation runs, {c.vaf:.1f} % on validation "
                "runs; the limit is 1.1.",
                meaning,
                self.then.overfit(could),
                "runs",
            )
        if c.one_step_vaf > GOOD_ONE_STEP and c.vaf < POOR:
            yield Finding(
                "one step only",
                f"Good one step ahead ({c.one_step_vaf:.1f} %), poor as a free run ({c.vaf:.1f} %)",
                "VAF of the same runs.",
                "The next sample is close to the last one, whatever the model. Only a free run "
                "shows whether it has the response.",
                Step(
                    "Judge by the free run; lower the sampling rate (Decimator), or search the "
                    "orders.",
                    "Judge by the free run; lower the sampling rate (skhoid identify --decimate N)"
                    ", or search the orders.",
                ),
                "overview",
            )

    def _overfit(self) -> tuple[bool, str]:
        """Whether the parameters can have learnt the noise, and what a higher error means."""
        c, p = self.c, self.then.n_parameters
        differ = "these runs differ from those the model was fitted to"
        either = f"The model has learnt the noise of its own runs, or {differ}."
        if p is None:
            return True, either
        seconds = float(c.by_run.loc[c.by_run["data"] == "estimation", "duration"].sum())
        groups = self.signals.groups
        outputs = [self.signals.y[rows[0] : rows[-1] + 1] for g in groups for rows in g.rows]
        n = 2 * band_edge(outputs, c.dt, 0.9) * seconds
        if can_have_learnt(p, n, c.overfit_ratio):
            return True, either
        return False, (
            f"{counted(p, 'parameter').capitalize()} cannot have learnt that much noise from "
            f"{seconds:.4g} s of data: {differ}."
        )

    def not_located(self, named: float, any_located: bool) -> Iterator[Finding]:
        """What is left to explain that no finding accounts for, or that nothing is."""
        c, gap = self.c, self.sure.get(("explainable gap", "residual"))
        several = bool(c.by_frequency["exceeds"].any() or c.by_time["exceeds"].any())
        if gap is not None and c.point_scale * gap.cost > SMALL and named < gap.cost / 2:
            what = "the findings above do not account for" if any_located else "no test locates"
            answers = "follows target and disturbance"
            if c.ceiling.route.separates:
                answers = "repeats with the target"
            yield Finding(
                "unknown",
                f"{self._points(gap.cost - named)} are left to explain that {what}",
                f"The residual {answers}, {p_text(gap.p)}: {self._both()}.",
                "Several small misfits (order, lag, second mode), or an effect that these views "
                "do not separate.",
                self.then.unknown(),
                "frequency",
                gap.cost,
            )
        elif not any_located and not self.sure and not several and c.ceiling.route.separates:
            yield Finding(
                "none",
                "Nothing found that these runs could show",
                f"No test exceeds chance when all are counted. {self._both()}; left to explain: "
                f"{gap_text(c.point_scale * c.explainable_gap)}.",
                "What the model does not explain does not repeat: as far as these runs can tell, "
                "it is remnant.",
                "Stop here, or record more runs to see smaller effects.",
                "overview",
            )

    def _both(self) -> str:
        """VAF and noise ceiling."""
        c = self.c
        vaf, ceiling = (c.about_mean(value) for value in (c.vaf, c.noise_ceiling))
        name = vaf_name(centered=c.mean_dominates)
        return f"{name} {vaf:.1f} %, noise ceiling {ceiling_text(ceiling)}"

    def of_design(self) -> Iterator[Finding]:
        """What these runs cannot show."""
        if self.c.ceiling.route is Route.NONE:
            yield Finding(
                "no ceiling",
                "How much is left to explain is not known",
                f"There is no noise ceiling: {self.c.ceiling.note}.",
                "A low VAF may be due to remnant or to misfit: these runs cannot tell.",
                "Record runs that share the target and the disturbance, or a whole number of "
                "periods of a multisine.",
                "ceiling",
            )
        groups = self.signals.groups
        if len(groups) == 1 and groups[0].n_runs > 1 and "f_t" in self.signals.channels:
            yield Finding(
                "one target",
                "All runs share one forcing function",
                f"{groups[0].n_runs} runs have the same target.",
                "Validation cannot separate what repeats with the target from what repeats with "
                "time.",
                Step(
                    "Record a second realisation of the target "
                    "(make_tracking_runs(random_phases=True) shows how they differ).",
                    "Record a second realisation of the target.",
                ),
            )


def curvature(table: pd.DataFrame, channel: str) -> float:
    """Above 0 where the response grows with the size of a channel: the part that goes as z |z|.

    The sizes are from zero. A cubic would bend about the mean of the channel, which an offset in
    the loop places far from zero.
    """
    own = table[table["channel"] == channel]
    z = own["center"].to_numpy() / max(float(own["center"].abs().max()), 1e-300)
    design = np.column_stack([np.ones(z.size), z, z * np.abs(z)])
    weight = np.sqrt(own["count"].to_numpy())
    bent = np.linalg.lstsq(design * weight[:, None], own["mean"] * weight, rcond=None)[0][2]
    return float(bent * own["sign"].iloc[0])
