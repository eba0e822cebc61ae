"""Advice on what to do next, worded for the kind of model that was compared."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..effects.composition import Effects
from ..effects.registry import title_of
from ..interpret.arx_channel import is_arx
from ..model.operator_regressor import OperatorRegressor
from ..pipelines import taken_apart
from ..preprocessing import DelayShift
from ..preprocessing.base import as_fitted
from ..runs.roles import is_external, role_of
from ..text import counted


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
