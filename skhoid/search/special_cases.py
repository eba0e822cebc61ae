"""Special cases before the general forms that contain them; which contain which, effects say."""

from __future__ import annotations

import numpy as np

from .candidates import LEAST_DELTA_BIC, Candidate, SearchStep
from .in_loop import LEAST_DELTA_BIC as LEAST_IN_LOOP
from .in_loop import LEAST_GAIN as LEAST_GAIN_IN_LOOP


def special_cases_of(general: Candidate, candidates: list[Candidate]) -> list[Candidate]:
    """Candidates that a general form contains, so far as they pass, the likeliest first."""
    special = [c for c in candidates if general.id in c.effect.within and c.passes]
    return sorted(special, key=lambda c: -c.weight)


def as_good(special: Candidate, general: Candidate) -> bool:
    """Whether what a general form has beyond a special case would not count as an effect.

    That is asked as of any other effect: in the closed loop where that has judged both as linear,
    else by ΔBIC and by points of held-out rows. A general form also takes up errors of the
    simulation and of the noise model, so that ΔBIC prefers it in long records, whatever is true.
    Where it has no more parameters, so that the special case is one in the limit only, the unbiased
    likelihood decides, if it is known.
    """
    one, other = special.in_loop, general.in_loop
    if one is not None and other is not None and special.linear_in_loop and general.linear_in_loop:
        more, gain = other.delta_bic - one.delta_bic, other.gain - one.gain
        if more <= LEAST_IN_LOOP or gain < LEAST_GAIN_IN_LOOP:
            return True
    joint, more = general.joint - special.joint, general.weight - special.weight
    if general.n_parameters > special.n_parameters:
        fewer_points = general.gain - special.gain < special.least_gain
        return bool(more <= LEAST_DELTA_BIC or fewer_points)
    return bool((joint if np.isfinite(joint) else more) <= LEAST_DELTA_BIC)


def special_first(step: SearchStep) -> None:
    """Put a special case before the best of a step, where that has nothing beyond it that counts.

    It must have passed all criteria itself, those of the closed loop and of rows left out included.
    """
    general = step.best
    if general is None or general.trace:
        return
    for special in special_cases_of(general, step.candidates):
        if step.judge(special) and as_good(special, general):
            step.candidates.remove(special)
            step.candidates.insert(0, special)
            return
