"""Whether a model of a search rebuilds the output from the response of the controlled element."""

from __future__ import annotations

import numpy as np

from ..diagnosis.leaks import LeakTest, leak_test
from ..greybox.model import Model


def leak_of(model: Model) -> LeakTest | None:
    """The leak test of a model's free run; None where x is not measured, or nobody steers."""
    record = model.simulator.record
    names = record.with_role("x")
    if not names or record.y is None or record.roles.get(record.inputs[0]) != "e":
        return None
    x = record.channels[names[0]]
    if x.shape != record.y.shape:
        return None
    recorded = record.with_role("dist")[:1]
    channels = {getattr(effect, "channel", None) for _, effect in model.effects}
    with np.errstate(all="ignore"):
        return leak_test(
            np.where(record.known, record.y, np.nan),
            model.output,
            x,
            record.dt,
            target=x + record.input,
            disturbance=record.channels[recorded[0]] if recorded else None,
            told=bool(recorded) and recorded[0] in channels,
            least_delay=record.least_delay or record.dt,
        )
