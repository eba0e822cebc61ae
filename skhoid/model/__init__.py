"""Grey-box models: physical parameters and effects, estimated in simulation."""

from ..parameters import ModelParameter, ParameterTable
from .estimator import GreyBox
from .operator_regressor import OperatorRegressor
from .prepared import SimulatedCore, SimulatedModel
from .simulated_arx import SimulatedARX

__all__ = [
    "GreyBox",
    "ModelParameter",
    "OperatorRegressor",
    "ParameterTable",
    "SimulatedARX",
    "SimulatedCore",
    "SimulatedModel",
]
