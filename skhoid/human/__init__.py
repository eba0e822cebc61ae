"""Physics as small objects: human operator, controlled element, time-varying parameters."""

from .controlled_element import ELEMENT as ELEMENT
from .controlled_element import ControlledElement
from .linear_element import LinearElement
from .operator import HumanOperator, crossover, delay_samples, zoh_parameters
from .variation import Mixture, Ramp, Sigmoid, Step

# What the lab uses, and no user needs.
from .variation import mix as mix

__all__ = [
    "ControlledElement",
    "HumanOperator",
    "LinearElement",
    "Mixture",
    "Ramp",
    "Sigmoid",
    "Step",
    "crossover",
    "delay_samples",
    "zoh_parameters",
]
