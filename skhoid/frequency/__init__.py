"""Frequency responses: of models, from Fourier coefficients, with their variances."""

from .arx import arx_response, arx_response_covariance
from .crossover import crossover_path
from .fourier import fourier_coefficients
from .response import FrequencyResponse
from .spectrum import auto_psd

__all__ = [
    "FrequencyResponse",
    "arx_response",
    "arx_response_covariance",
    "auto_psd",
    "crossover_path",
    "fourier_coefficients",
]
