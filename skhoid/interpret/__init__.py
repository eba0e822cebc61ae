"""Interpret models and recordings: operator parameters, frequency responses, crossover."""

from .arx_responses import arx_response, arx_response_covariance
from .conversion import arx_to_operator, operator_parameters
from .crossing import crossover_path
from .fourier import fourier_coefficients
from .references import reference_fits
from .response import FrequencyResponse
from .spectrum import auto_psd

__all__ = [
    "FrequencyResponse",
    "arx_response",
    "arx_response_covariance",
    "arx_to_operator",
    "auto_psd",
    "crossover_path",
    "fourier_coefficients",
    "operator_parameters",
    "reference_fits",
]
