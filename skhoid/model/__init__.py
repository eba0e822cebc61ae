"""Grey-box models: physical parameters and effects, estimated in simulation."""

from .base import GreyBox
from .operator_regressor import OperatorRegressor
from .prepared import SimulatedCore
from .protocol import SimulatedModel

__all__ = ["GreyBox", "OperatorRegressor", "SimulatedCore", "SimulatedModel"]
