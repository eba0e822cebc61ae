"""Delay and bias of batch models against the remnant filter (Figs. 9-12, App. G)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from ....human.operator import delay_samples, zoh_parameters
from ....interpret.conversion import FROM_POLES, arx_to_operator
from ..montecarlo.blocks import Block
from ..montecarlo.declared import identified_as
from ..montecarlo.horizons import KEPT, candidate_delays, shifted, succeeded
from ..montecarlo.study import MonteCarloStudy
from ..montecarlo.vectorised import PARAMETERS, delay_losses, least_squares
from .study_result import (
    INTENSITIES,
    STATES,
    Claim,
    StudyResult,
    checked_orders,
    gains_of,
    range_text,
)

ALL_ORDERS = (1, 2, 3, 4, "nm")
FIXED, ESTIMATED = "fixed", "estimated"
BIASES = [f"bias_{name}" for name in PARAMETERS]
LOW, HIGH = 20.0, 100.0  # rad/s, of the weights compared (Fig. 11)
NEGLIGIBLE = 0.5  # VAF points
CELL = ["condition", "remnant_order", "remnant_intensity", "sampling_rate", "open_loop"]


@identified_as("skhoid: delays and bias", version=1)
def delays_and_bias(block: Block) -> pd.DataFrame:
    """Batch models with the true and the estimated delay, for a :class:`MonteCarloStudy`."""
    task, rate = block.task, block.task.sampling_rate
    before, n_runs = int((block.record.time < 0).sum()), len(block.replications)
    truth = zoh_parameters(task.operator, 1 / rate)
    nk_true = delay_samples(task.operator, 1 / rate, nearest=True)
    e, u = block.record.e, block.record.u
    nks = candidate_delays(task)
    losses, _ = delay_losses(e, u, before, nks)
    estimated = nks[losses.argmin(axis=1)]
    tables = []
    for name, delays in ((FIXED, np.full(n_runs, nk_true)), (ESTIMATED, estimated)):
        e_shifted = np.concatenate(
            [shifted(e[[i]], before, nk) for i, nk in enumerate(delays)], axis=0
        )
        theta = least_squares(e_shifted, u[:, before:])
        found: dict[str, Any] = {"replication": block.replications, "delay": name, "nk": delays}
        found |= dict(zip(PARAMETERS, theta.T, strict=True))
        found |= dict(zip(BIASES, (theta / truth - 1).T, strict=True))
        values, _, _ = arx_to_operator(theta, 1 / rate)
        found |= {parameter: values[parameter] for parameter in FROM_POLES}
        found["weight_ratio"] = _weight(theta, HIGH / rate) / _weight(theta, LOW / rate)
        if block.validation is not None:
            e_v, u_v = block.validation.e, block.validation.u[:, before:]
            found["vaf_validation"] = [
                _vaf(row, shifted(e_v, before, nk, extra=1), u_v)
                for row, nk in zip(theta, delays, strict=True)
            ]
        tables.append(pd.DataFrame(found))
    return pd.concat(tables)


def _weight(theta: np.ndarray, angle: float) -> np.ndarray:
    """|A(e^-jw)|^2, which weighs the bias over frequency (Section V-A)."""
    z = np.exp(-1j * angle)
    return np.abs(1 + theta[:, 0] * z + theta[:, 1] * z**2) ** 2


def _vaf(theta: np.ndarray, e: np.ndarray, u: np.ndarray) -> float:
    """Mean VAF of free runs from zero output, with the error known one sample before."""
    driven = theta[2] * e[:, 1:] + theta[3] * e[:, :-1]
    free = lfilter([1.0], [1.0, theta[0], theta[1]], driven, axis=1)
    lost = np.sum((u - free) ** 2, axis=1) / np.sum(u**2, axis=1)
    return float(np.maximum(0.0, 100 * (1 - lost)).mean())


def delay_study(
    n_replications: int = 100,
    *,
    conditions: Sequence[str] = STATES,
    orders: Sequence[Any] = ALL_ORDERS,
    intensities: Sequence[float] = INTENSITIES,
    sampling_rates: Sequence[float] = (100.0,),
    open_loop: Sequence[bool] = (False,),
    n_validation: int = 10,
    gains: str = "table",
    random_state: Any = 0,
    out: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    progress: bool | None = None,
) -> StudyResult:
    """Delay, bias and validation VAF of batch models for different remnant filters.

    Figs. 9, 10 and 12 of the thesis and, with all sampling rates and both loops, Figs. G.1-G.8. For
    each run an ARX[2, 2] model is fitted to the measurement window with the true delay n_k^0 and
    with n_k*, the delay of lowest one-step loss between 0.15 and 0.48 s. All cells share their
    noise, so filters are compared on the same realisations.

    Parameters
    ----------
    n_replications : int, default=100
        Runs per cell.
    conditions : sequence of str, default=("C1", "C2")
        Conditions with constant dynamics.
    orders : sequence of {1, 2, 3, 4, "nm"}, default=(1, 2, 3, 4, "nm")
        Orders of the remnant filter.
    intensities : sequence of float, default=(0, 0.05, ..., 0.30)
        P_n.
    sampling_rates : sequence of float, default=(100,)
        Sampling rates in Hz; App. G has 50, 100 and 200.
    open_loop : sequence of bool, default=(False,)
        Whether the remnant goes round the loop (False) or not (True, Eq. G.1).
    n_validation : int, default=10
        Validation runs per cell, for Fig. 12; 0 for none.
    gains : {"table", "tuned"}, default="table"
        K_n from Table G.1, or tuned on ten realisations with their own seeds.
    random_state : int, RandomState, Generator or None, default=0
        Source of all randomness.
    out : path or None, default=None
        Folder in which finished blocks are kept; see :meth:`MonteCarloStudy.run`.
    n_jobs : int or None, default=None
        Number of workers, as in joblib.
    progress : bool or None, default=None
        Show a progress bar; None means only in a terminal.

    Returns
    -------
    result : StudyResult
        Its table has two rows per replication, ``delay`` "fixed" and "estimated": nk, the ARX
        parameters and their relative bias (Eq. 30), those of the operator (Eqs. 22-23),
        ``weight_ratio`` (of ``|A|^2`` at 100 and at 20 rad/s, Fig. 11) and ``vaf_validation``
        (whole window, %).

    Examples
    --------
    >>> from skhoid.lab.studies.thesis import delay_study
    >>> found = delay_study(4, conditions=["C1"], orders=[2, 4], intensities=[0.15], n_validation=0)
    >>> found.summary["nk_estimated"].round(1).tolist()
    [31.2, 26.8]
    """
    study = MonteCarloStudy(
        delays_and_bias,
        {
            "condition": list(conditions),
            "remnant_order": checked_orders(orders),
            "remnant_intensity": [float(P_n) for P_n in intensities],
            "sampling_rate": [float(rate) for rate in sampling_rates],
            "open_loop": [bool(loop) for loop in open_loop],
        },
        n_replications,
        n_validation_runs=n_validation,
        simulation={"keep_run_in": KEPT} | gains_of(gains, intensities),
        common_noise=True,
        batched=True,
        block_size=50,
        random_state=random_state,
    )
    table = study.run(out, n_jobs=n_jobs, progress=progress)
    table["remnant_order"] = table["remnant_order"].astype(str)
    good = succeeded(table)
    summary = _summary(good)
    return StudyResult(
        "fig9",
        "Delay and bias of batch ARX models against the remnant filter (Figs. 9-12, App. G)",
        table,
        summary,
        _claims(summary),
        _figures(good),
    )


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means over replications, a row a cell."""
    names = ["nk", *BIASES, *FROM_POLES]
    names += ["vaf_validation"] if "vaf_validation" in table else []
    means = table.groupby([*CELL, "delay"], sort=False)[names].mean().unstack("delay")
    means.columns = [f"{name}_{delay}" for name, delay in means.columns]
    deviation = table[table["delay"] == ESTIMATED].groupby(CELL, sort=False)["nk"].std()
    ratio = table[table["delay"] == FIXED].groupby(CELL, sort=False)["weight_ratio"].median()
    return means.assign(sd_nk_estimated=deviation, median_weight_ratio=ratio)


def _claims(summary: pd.DataFrame) -> list[Claim]:
    frame = summary.reset_index()
    frame = frame[(frame["sampling_rate"] == 100.0) & ~frame["open_loop"]]
    if frame.empty:
        return []
    quiet, noisy = frame[frame["remnant_intensity"] == 0], frame[frame["remnant_intensity"] > 0]
    above = noisy["nk_estimated"] - noisy["nk_fixed"]
    claims = []
    if len(quiet):
        nk, true = quiet["nk_estimated"], quiet["nk_fixed"]
        claims.append(
            Claim(
                "Fig. 9",
                "without remnant n_k* = n_k^0",
                f"{range_text(nk, 0)} where it is {range_text(true, 0)}",
                bool((nk == true).all()),
            )
        )
    statements = {
        "1": ("orders 1 and 2 overestimate the delay: order 1", lambda d: d > 0),
        "2": ("orders 1 and 2 overestimate the delay: order 2", lambda d: d > 0),
        "3": ("orders 3 and 4 underestimate it (shown for C1): order 3", lambda d: d < 0),
        "4": ("orders 3 and 4 underestimate it (shown for C1): order 4", lambda d: d < 0),
        "nm": ("with the neuromuscular filter n_k* is centred on n_k^0", lambda d: abs(d) < 1),
    }
    for order, (statement, holds) in statements.items():
        for condition in dict.fromkeys(noisy["condition"]):
            of = (noisy["remnant_order"] == order) & (noisy["condition"] == condition)
            if of.any():
                found = f"{range_text(above[of], 1, sign=True)} samples in {condition}"
                claims.append(Claim("Fig. 9", statement, found, bool(holds(above[of]).all())))
    first = noisy["remnant_order"] == "1"
    if first.any():
        mean = above[first].mean()
        claims.append(
            Claim(
                "Fig. 9",
                "order 1: seven samples from n_k^0 on average",
                f"{mean:+.1f}",
                bool(abs(mean - 7) <= 1.0),
            )
        )
    return [*claims, *_bias_claims(noisy), *_other_claims(noisy)]


def _bias_claims(noisy: pd.DataFrame) -> list[Claim]:
    size = noisy.set_index(["condition", "remnant_intensity", "remnant_order"])
    size = size[[f"{name}_{FIXED}" for name in BIASES]]
    of_order = size.abs().mean(axis=1).unstack("remnant_order")
    claims = []
    if "1" in of_order and of_order.shape[1] > 1:
        others = size.abs().drop("1", level="remnant_order")
        largest = others.groupby(["condition", "remnant_intensity"]).max()
        ratio = size.abs().xs("1", level="remnant_order") / largest
        claims.append(
            Claim(
                "Fig. 10",
                "the relative bias of order 1 is more than ten times that of the others",
                f"{range_text(ratio, 1)} times in single parameters and intensities",
                bool((ratio > 10).all(axis=None)),
            )
        )
    if "nm" in of_order and of_order.shape[1] > 1:
        best = of_order.idxmin(axis=1) == "nm"
        claims.append(
            Claim(
                "Fig. 10",
                "the neuromuscular filter gives the lowest bias",
                f"in {best.sum()} of {best.size} cells",
                bool(best.all()),
            )
        )
    signs = np.sign(size.groupby("remnant_order").mean())
    low = [order for order in signs.index if order in ("1", "2")]
    if 0 < len(low) < len(signs):
        wanted = pd.DataFrame(1.0, signs.index, signs.columns)
        wanted.iloc[:, 2:] = -1.0  # b0 and b1
        wanted.loc[low] *= -1.0
        apart = bool((signs == wanted).all(axis=None))
        claims.append(
            Claim(
                "Fig. 10",
                "orders 1 and 2 on one side, 3, 4 and nm on the other, a and b against each other",
                "B_r < 0 in a and > 0 in b for 1 and 2, the opposite for the rest (by Eq. 30; "
                "the text has the opposite signs)"
                if apart
                else f"signs {signs.to_dict()}",
                apart,
            )
        )
    return claims


def _other_claims(noisy: pd.DataFrame) -> list[Claim]:
    claims = []
    for order, thesis, range_ in (("1", 15.0, (10.0, 25.0)), ("2", 1000.0, (300.0, 3000.0))):
        cell = (noisy["remnant_order"] == order) & np.isclose(noisy["remnant_intensity"], 0.15)
        cell &= noisy["condition"] == "C1"
        if cell.any():
            found = float(noisy.loc[cell, "median_weight_ratio"].iloc[0])
            claims.append(
                Claim(
                    "Fig. 11",
                    f"order {order}: |A|^2 at 100 rad/s is {thesis:g} times that at 20 (read from "
                    "one realisation)",
                    f"{found:.0f} (median)",
                    bool(range_[0] < found < range_[1]),
                )
            )
    second = noisy[noisy["remnant_order"] == "2"]
    if "vaf_validation_fixed" in second and len(second):
        gain = second["vaf_validation_fixed"] - second["vaf_validation_estimated"]
        claims.append(
            Claim(
                "Fig. 12",
                "order 2: the validation VAF with n_k^0 and with n_k* show no relevant difference",
                f"mean {range_text(gain, 2, sign=True)} points",
                bool((gain.abs() < NEGLIGIBLE).all()),
            )
        )
    if len(second):
        omega = second["omega_nm_fixed"]
        claims.append(
            Claim(
                "Section V-B",
                "order 2: omega_nm and zeta_nm are overestimated (11.25 rad/s and 0.35)",
                f"{range_text(omega, 1)} rad/s and {range_text(second['zeta_nm_fixed'])}",
                bool((omega > 11.25).all() and (second["zeta_nm_fixed"] > 0.35).all()),
            )
        )
    return claims


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    """Figs. 9 and 10 of each condition, rate and loop there is, and Fig. 12."""
    columns = ["condition", "sampling_rate", "open_loop"]
    figures: dict[str, Any] = {}
    for (condition, rate, open_loop), part in table.groupby(columns, sort=False):
        where = f"{condition}-{rate:g}Hz" + ("-open-loop" if open_loop else "")
        figures[f"fig9-{where}"] = partial(_draw_delays, part)
        figures[f"fig10-{where}"] = partial(_draw_bias, part)
    second = table[table["remnant_order"] == "2"]
    if "vaf_validation" in table and len(second):
        figures["fig12"] = partial(_draw_difference, second)
    return figures


def _draw_delays(table: pd.DataFrame) -> Any:
    from ....plotting import StudyBoxDisplay

    estimated = table[table["delay"] == ESTIMATED]
    true = float(table.loc[table["delay"] == FIXED, "nk"].iloc[0])
    return StudyBoxDisplay.from_table(estimated, "nk", reference=true)


def _draw_bias(table: pd.DataFrame) -> Any:
    from ....plotting import StudyBoxDisplay

    return StudyBoxDisplay.from_table(table, BIASES, by="delay")


def _draw_difference(table: pd.DataFrame) -> Any:
    from ....plotting import StudyBoxDisplay

    return StudyBoxDisplay.from_table(
        table, "vaf_validation", group="condition", difference=("delay", FIXED, ESTIMATED)
    )
