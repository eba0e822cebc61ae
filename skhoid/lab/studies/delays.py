"""Delay and bias of batch models against the remnant filter (Figs. 9-12, App. G)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from ... import arx_to_operator, zoh_parameters
from ...arx.many_runs import PARAMETERS, fit_runs, search_delays
from ...human import delay_samples
from ...interpret import FROM_POLES
from .blocks import Block
from .declared import INTENSITIES, STATES, Claim, PaperStudy, range_text
from .memory_horizons import KEPT, candidate_delays, shifted

ALL_ORDERS = (1, 2, 3, 4, "nm")
FIXED, ESTIMATED = "fixed", "estimated"
BIASES = [f"bias_{name}" for name in PARAMETERS]
LOW, HIGH = 20.0, 100.0  # rad/s, of the weights compared (Fig. 11)
NEGLIGIBLE = 0.5  # VAF points
CELL = ["condition", "remnant_order", "remnant_intensity", "sampling_rate", "open_loop"]


def delays_and_bias(block: Block) -> pd.DataFrame:
    """Batch models with the true and the estimated delay, for a :class:`MonteCarloStudy`."""
    task, rate = block.task, block.task.sampling_rate
    before, n_runs = int((block.record.time < 0).sum()), len(block.replications)
    truth = zoh_parameters(task.operator, 1 / rate)
    nk_true = delay_samples(task.operator, 1 / rate, nearest=True)
    e, u = block.record.e, block.record.u
    nks = candidate_delays(task)
    losses, _ = search_delays(e, u, before, nks)
    estimated = nks[losses.argmin(axis=1)]
    tables = []
    for name, delays in ((FIXED, np.full(n_runs, nk_true)), (ESTIMATED, estimated)):
        e_shifted = np.concatenate(
            [shifted(e[[i]], before, nk) for i, nk in enumerate(delays)], axis=0
        )
        theta = fit_runs(e_shifted, u[:, before:])
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


def _summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means over replications, a row a cell."""
    names = ["nk", *BIASES, *FROM_POLES]
    names += ["vaf_validation"] if "vaf_validation" in table else []
    means = table.groupby([*CELL, "delay"], sort=False)[names].mean().unstack("delay")
    means.columns = [f"{name}_{delay}" for name, delay in means.columns]
    deviation = table[table["delay"] == ESTIMATED].groupby(CELL, sort=False)["nk"].std()
    ratio = table[table["delay"] == FIXED].groupby(CELL, sort=False)["weight_ratio"].median()
    return means.assign(sd_nk_estimated=deviation, median_weight_ratio=ratio)


def _claims(summary: pd.DataFrame, table: pd.DataFrame) -> Iterator[Claim]:
    frame = summary.reset_index()
    frame = frame[(frame["sampling_rate"] == 100.0) & ~frame["open_loop"]]
    if frame.empty:
        return
    quiet, noisy = frame[frame["remnant_intensity"] == 0], frame[frame["remnant_intensity"] > 0]
    above = noisy["nk_estimated"] - noisy["nk_fixed"]
    if len(quiet):
        nk, true = quiet["nk_estimated"], quiet["nk_fixed"]
        yield Claim(
            "Fig. 9",
            "without remnant n_k* = n_k^0",
            f"{range_text(nk, 0)} where it is {range_text(true, 0)}",
            bool((nk == true).all()),
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
                yield Claim("Fig. 9", statement, found, bool(holds(above[of]).all()))
    first = noisy["remnant_order"] == "1"
    if first.any():
        mean = above[first].mean()
        yield Claim(
            "Fig. 9",
            "order 1: seven samples from n_k^0 on average",
            f"{mean:+.1f}",
            bool(abs(mean - 7) <= 1.0),
        )
    yield from _bias_claims(noisy)
    yield from _other_claims(noisy)


def _bias_claims(noisy: pd.DataFrame) -> Iterator[Claim]:
    size = noisy.set_index(["condition", "remnant_intensity", "remnant_order"])
    size = size[[f"{name}_{FIXED}" for name in BIASES]]
    of_order = size.abs().mean(axis=1).unstack("remnant_order")
    if "1" in of_order and of_order.shape[1] > 1:
        others = size.abs().drop("1", level="remnant_order")
        largest = others.groupby(["condition", "remnant_intensity"]).max()
        ratio = size.abs().xs("1", level="remnant_order") / largest
        yield Claim(
            "Fig. 10",
            "the relative bias of order 1 is more than ten times that of the others",
            f"{range_text(ratio, 1)} times in single parameters and intensities",
            bool((ratio > 10).all(axis=None)),
        )
    if "nm" in of_order and of_order.shape[1] > 1:
        best = of_order.idxmin(axis=1) == "nm"
        yield Claim(
            "Fig. 10",
            "the neuromuscular filter gives the lowest bias",
            f"in {best.sum()} of {best.size} cells",
            bool(best.all()),
        )
    signs = np.sign(size.groupby("remnant_order").mean())
    low = [order for order in signs.index if order in ("1", "2")]
    if 0 < len(low) < len(signs):
        wanted = pd.DataFrame(1.0, signs.index, signs.columns)
        wanted.iloc[:, 2:] = -1.0  # b0 and b1
        wanted.loc[low] *= -1.0
        apart = bool((signs == wanted).all(axis=None))
        yield Claim(
            "Fig. 10",
            "orders 1 and 2 on one side, 3, 4 and nm on the other, a and b against each other",
            "B_r < 0 in a and > 0 in b for 1 and 2, the opposite for the rest (by Eq. 30; "
            "the text has the opposite signs)"
            if apart
            else f"signs {signs.to_dict()}",
            apart,
        )


def _other_claims(noisy: pd.DataFrame) -> Iterator[Claim]:
    for order, thesis, range_ in (("1", 15.0, (10.0, 25.0)), ("2", 1000.0, (300.0, 3000.0))):
        cell = (noisy["remnant_order"] == order) & np.isclose(noisy["remnant_intensity"], 0.15)
        cell &= noisy["condition"] == "C1"
        if cell.any():
            found = float(noisy.loc[cell, "median_weight_ratio"].iloc[0])
            yield Claim(
                "Fig. 11",
                f"order {order}: |A|^2 at 100 rad/s is {thesis:g} times that at 20 (read from "
                "one realisation)",
                f"{found:.0f} (median)",
                bool(range_[0] < found < range_[1]),
            )
    second = noisy[noisy["remnant_order"] == "2"]
    if "vaf_validation_fixed" in second and len(second):
        gain = second["vaf_validation_fixed"] - second["vaf_validation_estimated"]
        yield Claim(
            "Fig. 12",
            "order 2: the validation VAF with n_k^0 and with n_k* show no relevant difference",
            f"mean {range_text(gain, 2, sign=True)} points",
            bool((gain.abs() < NEGLIGIBLE).all()),
        )
    if len(second):
        omega = second["omega_nm_fixed"]
        yield Claim(
            "Section V-B",
            "order 2: omega_nm and zeta_nm are overestimated (11.25 rad/s and 0.35)",
            f"{range_text(omega, 1)} rad/s and {range_text(second['zeta_nm_fixed'])}",
            bool((omega > 11.25).all() and (second["zeta_nm_fixed"] > 0.35).all()),
        )


def _figures(table: pd.DataFrame) -> dict[str, Any]:
    """Figs. 9 and 10 of each condition, rate and loop there is, and Fig. 12."""
    columns = ["condition", "sampling_rate", "open_loop"]
    figures: dict[str, Any] = {}
    for (condition, rate, open_loop), part in table.groupby(columns, sort=False):
        where = f"{condition}-{rate:g}Hz" + ("-open-loop" if open_loop else "")
        estimated = part[part["delay"] == ESTIMATED]
        true = float(part.loc[part["delay"] == FIXED, "nk"].iloc[0])
        figures[f"fig9-{where}"] = partial(_draw, estimated, "nk", reference=true)
        figures[f"fig10-{where}"] = partial(_draw, part, BIASES, by="delay")
    second = table[table["remnant_order"] == "2"]
    if "vaf_validation" in table and len(second):
        options = {"group": "condition", "difference": ("delay", FIXED, ESTIMATED)}
        figures["fig12"] = partial(_draw, second, "vaf_validation", **options)
    return figures


def _draw(table: pd.DataFrame, values: Any, **options: Any) -> Any:
    from ...plotting import StudyBoxDisplay

    return StudyBoxDisplay.from_table(table, values, **options)


DELAYS = PaperStudy(
    "delay estimates against the remnant filter",
    "Delay and bias of batch ARX models against the remnant filter (Figs. 9-12, App. G)",
    {
        "conditions": STATES,
        "orders": ALL_ORDERS,
        "intensities": INTENSITIES,
        "sampling_rates": (100.0,),
        "open_loop": (False,),
        "n_validation": 10,
        "gains": "table",
    },
    delays_and_bias,
    _summary,
    _claims,
    _figures,
    ("fig9",),
    {"keep_run_in": KEPT},
    # All cells share their noise, so filters are compared on the same realisations.
    {"common_noise": True, "batched": True, "block_size": 50},
)
