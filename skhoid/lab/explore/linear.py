"""The linear part of models: frequency response, poles and step response, as the component has it.

All numbers are of ``FrequencyResponse``, ``pole_table`` and ``step_response``; what was measured is
the response by way of the target that ``compare`` finds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from sklearn.pipeline import make_pipeline

from ... import DelayShift, FrequencyResponse, OperatorRegressor, SimulatedARX
from ...interpret import pole_table, step_response
from ...parameters import NORMAL_95

LOWEST, HIGHEST = 0.1, 30.0  # rad/s: where people steer; of a machine up to Nyquist
N_LINES = 80
N_INSTANTS = 121
SETTLED, LONGEST = 6.0, 10.0  # time constants, and s, of a step response
DIGITS = 6  # of numbers in a page that cannot compute
REFUSED = (
    "This controller answers the measurement beside the error, so no single response describes it."
)


def has_linear_part(estimator: Any) -> bool:
    """Whether it is a model whose linear part the library describes."""
    return isinstance(estimator, OperatorRegressor | SimulatedARX)


def describe_linear(
    models: Mapping[int, Any],
    measured: pd.DataFrame | None,
    domain: str,
    shift: DelayShift | None = None,
) -> dict[str, Any]:
    """What the component draws of fitted models, behind a fitted ``shift`` of their input.

    The first is the present one.
    """
    first = next(iter(models.values()))
    if shift is not None:
        models = {n: make_pipeline(shift, model) for n, model in models.items()}
    nyquist = np.pi / first.dt_
    highest = nyquist if domain == "machine" else min(HIGHEST, nyquist)
    omega = np.geomspace(min(LOWEST, highest / 100), highest, N_LINES)
    try:
        responses = {n: FrequencyResponse.of(model, omega) for n, model in models.items()}
        poles = {n: pole_table(model) for n, model in models.items()}
        delay = max(response.delay or 0.0 for response in responses.values())
        slow = max(table["time_constant"].max() for table in poles.values())
        known = np.isfinite(slow) and slow > 0
        time = np.linspace(
            0.0, min(delay + SETTLED * slow, LONGEST) if known else LONGEST, N_INSTANTS
        )
        steps = {n: step_response(model, time) for n, model in models.items()}
    except ValueError:
        return {"refused": REFUSED}
    own = next(iter(responses.values()))
    return {
        "refused": None,
        "input": own.input,
        "output": own.output,
        "without_effects": len(first.effects_) > 0,
        "omega": omega,
        "responses": [{"id": n, **_gain_and_phase(one)} for n, one in responses.items()],
        "measured": None if measured is None else _measured(measured, own, shift),
        "plane": next(iter(poles.values())).attrs["plane"],
        "poles": [
            {"id": n, "plane": one.attrs["plane"], **row}
            for n, one in poles.items()
            for row in one.to_dict("records")
        ],
        "time": time,
        "steps": [{"id": n, **_answer(one)} for n, one in steps.items()],
    }


def _gain_and_phase(response: FrequencyResponse) -> dict[str, Any]:
    """Gain, and phase in degrees, with 95 % intervals as ``BodeDisplay`` draws them."""
    gain, phase = response.magnitude, response.phase
    unknown = np.full(gain.shape, np.nan)
    sd_gain = unknown if response.magnitude_sd is None else response.magnitude_sd
    sd_phase = unknown if response.phase_sd is None else response.phase_sd
    return _with_intervals(gain, sd_gain, phase, sd_phase)


def _with_intervals(
    gain: np.ndarray, sd_gain: np.ndarray, phase: np.ndarray, sd_phase: np.ndarray
) -> dict[str, Any]:
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        factor = np.exp(NORMAL_95 * sd_gain / gain)
    spread = np.minimum(NORMAL_95 * sd_phase, 180.0)
    return {
        "gain": gain,
        "gain_low": gain / factor,
        "gain_high": gain * factor,
        "phase": phase,
        "phase_low": phase - spread,
        "phase_high": phase + spread,
    }


def _measured(
    table: pd.DataFrame, model: FrequencyResponse, shift: DelayShift | None
) -> dict[str, Any] | None:
    """The response by way of the target where its interval leaves zero out, in the model's turn.

    It was measured behind a ``shift`` of the input.
    """
    omega, gain, sd = (table[name].to_numpy() for name in ("omega", "measured_gain", "sd_gain"))
    seen = (NORMAL_95 * sd < gain) & (omega >= model.omega[0]) & (omega <= model.omega[-1])
    if not seen.any():
        return None
    omega, table = omega[seen], table[seen]
    phase = table["measured_phase"].to_numpy()
    if shift is not None:
        phase = phase - np.degrees(omega * shift.delay_)
    near = np.interp(np.log(omega), np.log(model.omega), model.phase)
    phase = phase - 360 * np.round((phase - near) / 360)
    sd_phase = table["sd_phase"].to_numpy()
    found = _with_intervals(gain[seen], sd[seen], phase, sd_phase)
    return {"omega": omega, **found, "coherence": table["coherence"].to_numpy()}


def _answer(step: pd.DataFrame) -> dict[str, np.ndarray]:
    output, spread = step["output"].to_numpy(), NORMAL_95 * step["sd"].to_numpy()
    return {"output": output, "low": output - spread, "high": output + spread}


def round_numbers(value: Any) -> Any:
    """The same with arrays as lists of short numbers, relative to each, for a page."""
    if isinstance(value, np.ndarray):
        return [float(f"{v:.{DIGITS}g}") for v in value]
    if isinstance(value, dict):
        return {key: round_numbers(one) for key, one in value.items()}
    return [round_numbers(one) for one in value] if isinstance(value, list) else value
