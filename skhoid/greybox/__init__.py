"""Models simulated from inputs, with physical parameters and effects, by maximum likelihood."""

from .base import GreyBox
from .operator_regressor import OperatorRegressor
from .prepared import SimulatedCore
from .protocol import SimulatedModel

__all__ = ["GreyBox", "OperatorRegressor", "SimulatedCore", "SimulatedModel"]
