"""Interpret models and recordings: operator parameters, frequency responses, crossover."""

from .arx_channel import arx_response, arx_response_covariance

# What the lab uses, and no user needs.
from .arx_channel import is_arx as is_arx
from .conversion import FROM_POLES as FROM_POLES
from .conversion import UNITS as UNITS
from .conversion import arx_to_operator, operator_parameters
from .fourier import auto_psd, fourier_coefficients
from .linear_part import pole_table, step_response
from .references import reference_fits
from .response import FrequencyResponse, crossover_path

__all__ = [
    "FrequencyResponse",
    "arx_response",
    "arx_response_covariance",
    "arx_to_operator",
    "auto_psd",
    "crossover_path",
    "fourier_coefficients",
    "operator_parameters",
    "pole_table",
    "reference_fits",
    "step_response",
]
