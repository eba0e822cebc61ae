"""Whether a model of a search rebuilds the output from the response of the controlled element."""

from __future__ import annotations

import numpy as np

from ..diagnosis.leaks import LeakTest, leak_of_channels
from ..model.model import Model


def leak_of(model: Model) -> LeakTest | None:
    """The leak test of a model's free run; None where x is not known, or nobody steers."""
    record = model.simulator.record
    if record.y is None or record.roles.get(record.inputs[0]) != "e":
        return None
    names: dict[str, str] = {}
    for name, role in record.roles.items():
        if role and record.channels[name].shape == record.y.shape:
            names.setdefault(role, name)
    channels = {role: record.channels[name] for role, name in names.items()}
    told = {getattr(effect, "channel", None) for _, effect in model.effects}
    with np.errstate(all="ignore"):
        return leak_of_channels(
            np.where(record.known, record.y, np.nan),
            model.output,
            channels,
            record.dt,
            told=lambda role: names[role] in told,
            least_delay=record.least_delay or record.dt,
        )
