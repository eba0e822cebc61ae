"""The human operator and what is controlled: physics as small objects."""

from .controlled_element import ControlledElement
from .conversion import arx_to_operator, operator_parameters
from .crossover import crossover
from .discretisation import delay_samples, pade, zoh_parameters
from .operator import HumanOperator
from .reference import reference_fits
from .variation import Mixture, Ramp, Sigmoid, Step

__all__ = [
    "ControlledElement",
    "HumanOperator",
    "Mixture",
    "Ramp",
    "Sigmoid",
    "Step",
    "arx_to_operator",
    "crossover",
    "delay_samples",
    "operator_parameters",
    "pade",
    "reference_fits",
    "zoh_parameters",
]
