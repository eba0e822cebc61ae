"""Advice on what to do next, worded for the kind of model that was compared."""

from __future__ import annotations

from typing import Any

from ..effects.composition import Effects
from ..greybox.operator_regressor import OperatorRegressor
from ..interpret.channel import is_arx
from ..pipelines import taken_apart
from ..preprocessing import DelayShift
from ..summaries import counted


class NextSteps:
    """Steps to take with a model, or a pipeline or search that ends in one."""

    def __init__(self, model: Any):
        self._before, self._model = taken_apart(model)
        self._operator = isinstance(self._model, OperatorRegressor)
        self._arx = is_arx(self._model)

    def delay(self, seconds: float) -> str:
        """For a delay that should be some seconds longer, or shorter where negative."""
        if self._operator:
            return self._delay_of_operator()
        if not self._arx:
            more = "more" if seconds > 0 else "less"
            return f"Delay the inputs of the model {abs(seconds):.2g} s {more}."
        if seconds > 0:
            return "Search the delay again, DelaySearchCV, or shift by as much with DelayShift."
        if any(isinstance(step, DelayShift) and step.delay for step in self._before):
            return "Shift by as much less with DelayShift, or search the delay with DelaySearchCV."
        samples = round(-seconds / self._model.dt_)
        if 0 < samples <= min(self._model.orders_.nk):
            return f"Take {counted(samples, 'sample')} off nk, or search it with DelaySearchCV."
        return "Search the delay again with DelaySearchCV."

    def _delay_of_operator(self) -> str:
        delay, effects = self._model.delay, Effects.of(self._model.effects)
        if delay is not None and all(effect.name != "wrong_delay" for _, effect in effects):
            return (
                f"Free the delay, which is given as {delay:g} s: delay=None, or "
                '.with_effect("wrong_delay").'
            )
        return (
            "The model estimates its delay: fit it on runs of the same condition, or search what "
            "else is missing (EffectSearchCV)."
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
        if self._operator:
            first = 'Add it, .with_effect("bias"), or s'
        else:
            first = "fit_intercept=True, or s" if hasattr(self._model, "fit_intercept") else "S"
        return f"{first}ubtract the mean of each run from X and y."

    def follow(self, signal: str) -> str:
        """For a residual that follows a signal from outside the loop."""
        if signal != "f_t":
            if self._operator:
                return 'Add it, .with_effect("disturbance").'
            return f"Add {signal!r} as an input."
        if self._operator:
            return 'Add .with_effect("feedforward") on a pursuit display, else "extra_lead".'
        return "On a pursuit display add the target as an input, inputs=['e', 'f_t']; else a lead."

    def overfit(self) -> str:
        longer = ", or a longer memory horizon" if hasattr(self._model, "coef_path_") else ""
        return f"Fewer parameters{longer}."

    def unknown(self) -> str:
        search = (
            "search the orders (OrderSearchCV)"
            if self._arx
            else "search the effects (EffectSearchCV)"
        )
        return f"Look at the response over frequency; {search}."
