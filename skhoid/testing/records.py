"""Synthetic records and signals on which the checks try effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..effects.operator_signals import Command, Gains, Spring
from ..effects.record import Record, differentiated
from ..human import LinearElement
from ..model.cores import neutral_gains
from ..runs.roles import OTHER

DT = 0.02  # s
DURATION = 24.0  # s
N_RUNS = 3
SILENT = 2.0  # s of zeros at the start, so that a later start only shifts time
DELAY = 0.2  # s
OPERATOR = {"K_e": 0.8, "K_edot": 0.3, "omega_nm": 9.0, "zeta_nm": 0.4}


def synthetic_record(channels: Sequence[str] = ()) -> Record:
    """Runs of smooth random channels, silent at the beginning, the last one shorter.

    Parameters
    ----------
    channels : sequence of str, default=()
        Names of further channels, which get no role.

    Returns
    -------
    record : Record

    Examples
    --------
    >>> from skhoid.testing import synthetic_record
    >>> record = synthetic_record(["heat"])
    >>> list(record.channels), record.n_runs
    (['e', 'x', 'f_t', 'motion_acc', 'dist', 'speed', 'heat'], 3)
    """
    rng = np.random.default_rng(0)
    t = np.arange(round(DURATION / DT)) * DT

    def smooth() -> np.ndarray:
        omega = rng.uniform(0.3, 7.0, (12, 1, N_RUNS)) * 2 * np.pi / 6
        phase = rng.uniform(-np.pi, np.pi, omega.shape)
        waves = np.sin(omega * (t[:, None] - SILENT) + phase) / np.sqrt(6 * (1 + omega / 6))
        begin = np.clip((t - SILENT) / 1.0, 0.0, 1.0)[:, None]
        return begin**2 * (3 - 2 * begin) * waves.sum(axis=0)

    roles = {"e": "e", "x": "x", "f_t": "f_t", "motion_acc": "motion_acc", "dist": "dist"}
    roles |= dict.fromkeys(["speed", *channels], OTHER)
    values = {name: smooth() for name in roles}
    values["e"] /= values["e"].std()
    values["f_t"] = values["e"] + values["x"]
    known = np.ones((t.size, N_RUNS), dtype=bool)
    known[-round(4.0 / DT) :, -1] = False
    for channel in values.values():
        channel[~known] = 0.0
    y = differentiated(values["e"], DT) * 0.2 + 0.5 * values["e"]
    return Record(
        dt=DT,
        t=t[:, None],
        channels=values,
        roles=roles,
        inputs=("e",),
        known=known,
        y=y,
        controlled_element=LinearElement((5.0,), (1.0, 1.0, 0.0)),
        prediction=0.9 * y,
    )


def signal_at(place: str, record: Record, delay: float = DELAY) -> Any:
    """The signal that an effect at a place is given."""
    if place == "delay":
        return delay
    if place == "gain":
        return neutral_gains()
    if place in ("spring", "inside"):
        return Spring()
    late = record.delayed(record.input, delay)
    if place in ("path", "command"):
        return Command(OPERATOR["K_e"] * late, OPERATOR["K_edot"] * late, late, delay)
    return record.input.copy() if place == "input" else 0.7 * late


def split_parts(signal: Any) -> dict[str, np.ndarray]:
    """The arrays in a signal, by name."""
    if isinstance(signal, (Gains, Command, Spring)):
        return {k: np.asarray(v, dtype=float) for k, v in signal._asdict().items()}
    return {"": np.asarray(signal, dtype=float)}


def started_later(record: Record, shift: int) -> Record:
    """The record with some silent samples added before its start."""

    def padded(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros_like(values[:shift]), values])

    before = record.t[0] - record.dt * np.arange(shift, 0, -1)[:, None]
    return replace(
        record,
        t=np.concatenate([before, record.t]),
        channels={k: padded(v) for k, v in record.channels.items()},
        known=padded(record.known),
        y=None if record.y is None else padded(record.y),
        prediction=None,
        remembered={},
    )
