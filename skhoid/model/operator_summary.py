"""The summary of a fitted model with effects."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pandas as pd

from ..human import ControlledElement
from ..text import VAF_RULE, ModelSummary, estimates_table, grid_facts, quantity, signal_facts
from .model import AT_BOUND
from .two_estimates import difference_notes

if TYPE_CHECKING:
    from .base import Simulation


def simulated_summary(model: Any, simulation: Simulation) -> ModelSummary:
    """Summary of a model whose parameters minimise the simulation error."""
    output, element = model._output_name, model.controlled_element_
    facts = {
        "Model": simulation.spec.description,
        "Effects": ", ".join(model.effects_.names) or "none",
        **signal_facts(model),
        "Method": "maximum likelihood",
        "Rows": f"{model.n_rows_used_}",
        "Runs": f"{model._n_runs}",
        **grid_facts(model),
        "Residuals": f"{simulation.n_residuals} in the likelihood",
        "Settling": f"{simulation.settling:g} s left out",
        **fit_facts(model, simulation),
        "Noise model": f"AR({len(model.noise_ar_)})",
    }
    if element is not None:
        facts["Element"] = (
            f"K_c = {element.K_c:.4g}, omega_b = {element.omega_b:.4g} rad/s"
            if isinstance(element, ControlledElement)
            else str(element)
        )
    notes = [
        simulation.spec.errors_note,
        "They do not allow for effects that the model lacks: see compare and EffectSearchCV.",
        "VAF and RMSE are those of the fitted rows; summary(X, y) gives the VAF of others. "
        f"{VAF_RULE} Log-likelihood and BIC are without constants.",
    ]
    table = model.parameters_
    if not (table["sd"] > 0).all():
        notes.append("A dash in place of a standard error: given, at a bound, or not determined.")
    notes += delay_notes(table, getattr(simulation.spec.core, "least", 0.0))
    least_error = getattr(model, "simulation_parameters_", None)  # of an operator
    if least_error is not None:
        notes += difference_notes(table, least_error)
    return ModelSummary(
        f"{type(model).__name__}: {output} from {model.inputs_[0]}",
        facts,
        estimates_table(table),
        [
            *notes,
            *(f"{n}: {e.physics_in('human')} {e.formula}" for n, e in model.effects_),
        ],
    )


def fit_facts(model: Any, simulation: Simulation) -> dict[str, str]:
    """How good the fit is, as long as the parameters are those of the fit."""
    if not hasattr(model, "vaf_"):
        return {"Fit": "none: parameters were moved by hand"}
    return {
        "VAF, fit": f"{model.vaf_:.1f} % (free run)",
        "RMSE, fit": quantity(simulation.rmse, model._units.get(model._output_name))
        + " (free run)",
        "Log-likelihood": f"{model.loglik_:.1f}",
        "BIC": f"{model.bic_:.1f}",
    }


def delay_notes(table: pd.DataFrame, least: float) -> list[str]:
    """What to say about a delay that is at the least there is, or shorter."""
    if "tau_e" not in table.index:
        return []
    value, sd = float(table.loc["tau_e", "value"]), float(table.loc["tau_e", "sd"])
    if sd == 0.0 and value < least:
        return [f"The delay given, {value:.2f} s, is below the least of people, {least:.2f} s."]
    if sd != 0.0 and value <= least * (1 + AT_BOUND):
        return [
            f"tau_e is at its lower bound, {least:.2f} s: people do not respond sooner. The fit "
            "would make it shorter still: something else responds at once, or channels are "
            "misaligned."
        ]
    return []
