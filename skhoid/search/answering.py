"""What answers in a loop where nobody says so: a person, or a PI or PID controller, as rivals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..arx.base import ESTIMATE
from ..effects.paths import Bias
from ..model import OperatorRegressor
from ..model.controller import ControllerCore, fit_controller, list_forms
from ..model.extend import extended
from ..model.fitting import Criterion
from ..model.likelihood import JOINT_RATE, likeliest
from ..model.model import Model
from ..model.prepared import Prepared
from ..model.simulator import Simulator
from .probability import CERTAIN

AS_LATE = (0.1, 0.2)  # s, delays of people: see OperatorRegressor


def prepare_answering(model: Any, X: Any, y: Any, domain: str | None) -> Prepared:
    """The data of a model, which becomes a controller where the domain or the data say so.

    Only an operator of whom nothing else is known may become one.
    """
    open_ = isinstance(model, OperatorRegressor) and model.controller is None
    if open_ and domain == "machine":
        return model.set_params(controller="any").prepare(X, y)
    prepared = model.prepare(X, y)
    known = not open_ or model.delay is not None or model.least_delay is not None
    if domain is None and not known and not model.effects and find_controller(model, prepared):
        return model.set_params(controller="any").prepare(X, y)
    return prepared


def find_controller(model: OperatorRegressor, prepared: Prepared) -> bool:
    """Whether a controller without delay explains the output better than a person does.

    By the free run under the noise model of the better one, and by the likelihood of each with its
    own, and than the same controller as late as people are: they integrate too. Gains are
    positive: those of the element's inverse, which rebuilds any output, are not.
    """
    record = prepared.record
    person = model.first_fit(prepared)
    some = Criterion(record).coarse().record
    begun = replace(ControllerCore("pi", 0.0).add_to_record(some), initial=ESTIMATE)
    begun = replace(begun, criterion_rate=record.criterion_rate)
    plain = Criterion(begun)
    rivals = []
    for form in list_forms(record):
        core = ControllerCore(form, 0.0, zero=True)
        fitted = fit_controller(core, begun, plain)
        rivals += [fitted] if core.is_sound(fitted.theta) and fitted.theta[0] > 0.0 else []
    if not rivals:
        return False
    best = min(rivals, key=lambda one: one.sse)
    of_person = Simulator(person.simulator.core, person.effects, some)
    of_some = Criterion(some)
    beside = Model(of_person, person.fit).refined(of_some)
    if not best.sse < beside.sse:
        return False
    # An integral that begins anywhere is an offset, too, and a person may have one.
    beside = extended(beside, "bias", Bias(), of_some, of_some)
    if not best.sse < beside.sse:
        return False
    plain.set_noise(plain.remnant_model(best.output))
    worse, better = (one.refined(plain).sse for one in (beside, best))
    if not 0.5 * plain.n * np.log(worse / max(better, 1e-300)) > CERTAIN:
        return False
    own = find_likelihood(best)
    if not own - find_likelihood(beside) > CERTAIN:
        return False
    found: Any = best.simulator.core
    late = [ControllerCore(found.form, delay, zero=True) for delay in AS_LATE]
    return all(own > find_likelihood(fit_controller(one, begun, plain)) for one in late)


def find_likelihood(model: Model) -> float:
    """Log-likelihood of a model with its own noise model, in nats; NaN where it has no maximum."""
    found = likeliest(model.simulator, [model.theta], JOINT_RATE)
    return np.nan if found is None else -found[0] / 2
