"""The human operator and what is controlled: physics as small objects."""

from .controlled_element import ControlledElement
from .discretisation import delay_samples, pade, zoh_parameters
from .margins import crossover
from .operator import HumanOperator
from .variation import Mixture, Ramp, Sigmoid, Step

__all__ = [
    "ControlledElement",
    "HumanOperator",
    "Mixture",
    "Ramp",
    "Sigmoid",
    "Step",
    "crossover",
    "delay_samples",
    "pade",
    "zoh_parameters",
]
