"""The function for studies of memory horizons: VAF of recursions on simulated runs by horizon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ....arx.recursive_cv import HORIZONS
from ....simulation.engine import operator_response
from ....simulation.task import CompensatoryTask
from .blocks import Block
from .declared import identified_as
from .vectorised import FORMS, delay_losses, least_squares, trade_off

KEPT = 1.0  # s kept of the run-in, so that shifted signals have a past; more for long delays
FIRST_PART = 30.72  # s: first and last part of a run, in which nothing changes
TRANSITION = (30.72, 51.20)  # s: where validation runs are scored
EARLIER, LATER = 0.13, 0.20  # s below and above tau_e: the range in which n_k / f_s is searched
SETTING = ["form", "memory_horizon"]


@identified_as("skhoid: forgetting VAF", version=1)
def forgetting_vaf(
    block: Block,
    *,
    memory_horizons: Sequence[float] = HORIZONS,
    window: tuple[float, float] = TRANSITION,
    init_window: float = FIRST_PART,
    scaled: bool = False,
    by_run: bool = False,
) -> pd.DataFrame:
    """VAF of recursions by memory horizon, for a :class:`MonteCarloStudy`.

    Each run has its own n_k*, theta0 from its first ``init_window`` seconds and P0 = I; with
    ``scaled`` the signals are first scaled to unit power there, so that P0 weighs as much as one
    sample whatever the units. With ``by_run`` there is a row for each validation run.
    """
    rate = block.task.sampling_rate
    before, first = int((block.record.time < 0).sum()), round(init_window * rate)
    begin, end = (round(instant * rate) for instant in window)
    assert block.validation is not None
    nks = candidate_delays(block.task)
    e, u, e_v, u_v = block.record.e, block.record.u, block.validation.e, block.validation.u
    n_runs = len(e)
    if (e == e[0]).all() and (u == u[0]).all():  # as without remnant
        e, u = e[:1], u[:1]
    losses, _ = delay_losses(e, u, before, nks)
    delays = nks[losses.argmin(axis=1)]
    rows = []
    for run, nk in enumerate(delays):
        one, many = (shifted(x, before, nk, extra=1) for x in (e[[run]], e_v))
        u_one, u_many = u[[run], before:], u_v[:, before:]
        if scaled:
            e_power, u_power = (
                np.sqrt(np.mean(signal[:, :first] ** 2)) for signal in (one[:, 1:], u_one)
            )
            one, many, u_one, u_many = (
                one / e_power, many / e_power, u_one / u_power, u_many / u_power,
            )  # fmt: skip
        theta0 = least_squares(one[:, 1 : first + 1], u_one[:, :first])[0]
        rows.append(
            trade_off(
                one[0, : end + 1], u_one[0, :end], theta0, many[:, : end + 1], u_many[:, :end],
                memory_horizons, FORMS, (begin, end),
            )
        )  # fmt: skip
    # runs, forms, horizons, recordings
    vaf = np.broadcast_to(np.array(rows), (n_runs, *rows[0].shape))
    of_validation = vaf[..., 1:] if by_run else vaf[..., 1:].mean(axis=-1, keepdims=True)
    shape = of_validation.shape

    def spread(values: Any, axis: int) -> np.ndarray:
        along = np.expand_dims(np.asarray(values), [i for i in range(4) if i != axis])
        return np.broadcast_to(along, shape).ravel()

    table = pd.DataFrame(
        {
            "replication": spread(block.replications, 0),
            "form": spread(np.array(FORMS, dtype=object), 1),
            "memory_horizon": spread(np.array(memory_horizons, dtype=float), 2),
            "nk": spread(np.broadcast_to(delays, n_runs), 0),
            "P_n": spread(block.record.intensity(), 0),
            "vaf_estimation": np.broadcast_to(vaf[..., :1], shape).ravel(),
            "vaf_validation": of_validation.ravel(),
        }
    )
    if by_run:
        table.insert(3, "validation", spread(range(len(e_v)), 3))
    else:
        table["sd_validation"] = (
            vaf[..., 1:].std(axis=-1, ddof=1).ravel() if len(e_v) > 1 else np.nan
        )
    return table


def with_gain(table: pd.DataFrame, data_set: list[str]) -> pd.DataFrame:
    """The gain in VAF over no forgetting (Eqs. 31-32), of the same data set and form."""
    columns = [*data_set, "form"]
    endless = table[np.isinf(table["memory_horizon"])].set_index(columns)["vaf_validation"]
    base = table.join(endless.rename("base"), on=columns)["base"]
    return table.assign(gain=table["vaf_validation"] - base)


def candidate_delays(task: CompensatoryTask) -> np.ndarray:
    """n_k around the operator's delay: from 0.15 to 0.48 s in the conditions of the thesis."""
    delay = operator_response(task).delay_time
    shortest, longest = (round((delay + apart) * task.sampling_rate) for apart in (-EARLIER, LATER))
    return np.arange(max(shortest, 1), longest + 1)


def kept_run_in(task: CompensatoryTask) -> float:
    """Seconds of the run-in that shifting by any of the candidate delays needs."""
    kept = max(KEPT, operator_response(task).delay_time + 2 * LATER)
    there = task.n_run_in / task.sampling_rate
    if there < kept:
        raise ValueError(
            f"The task has a run-in of {there:g} s; {kept:g} s are needed, because the error "
            "must be known one delay before the measurement window. Use run_in=None, or a longer "
            "run-in."
        )
    return kept


def shifted(e: np.ndarray, before: int, nk: int, extra: int = 0) -> np.ndarray:
    """e(t - n_k) of the window, of shape (n_runs, extra + n_samples), from run-in and window."""
    return e[:, before - nk - extra : e.shape[1] - nk]


def succeeded(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of data sets that did not fail."""
    return table[table["error"].isna()]
