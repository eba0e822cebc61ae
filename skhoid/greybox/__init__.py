"""Models simulated from inputs, with physical parameters and effects, by maximum likelihood."""

from .operator_regressor import OperatorRegressor

__all__ = ["OperatorRegressor"]
