"""Grey-box models: physical parameters and effects, estimated in simulation."""

from .estimator import GreyBox
from .operator_regressor import OperatorRegressor
from .prepared import SimulatedCore, SimulatedModel

__all__ = ["GreyBox", "OperatorRegressor", "SimulatedCore", "SimulatedModel"]
