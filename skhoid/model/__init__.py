"""Grey-box models: physical parameters and effects, estimated in simulation."""

from ..parameters import ModelParameter, ParameterTable
from .effect_curves import effect_curves as effect_curves
from .estimator import GreyBox
from .operator_regressor import OperatorRegressor
from .prepared import SimulatedCore
from .simulated_arx import SimulatedARX
from .simulated_arx import simulated_model as simulated_model

__all__ = [
    "GreyBox",
    "ModelParameter",
    "OperatorRegressor",
    "ParameterTable",
    "SimulatedARX",
    "SimulatedCore",
]
