"""Every picture: one Display per file, in the pattern of scikit-learn."""

from .bode import BodeDisplay
from .delay_loss import DelayLossDisplay
from .forgetting_profile import ForgettingProfileDisplay
from .memory_horizon import MemoryHorizonDisplay
from .operator_parameters import OperatorParametersDisplay
from .parameter_path import ParameterPathDisplay
from .simulation import SimulationDisplay
from .tracking import TrackingDisplay
from .vaf_contour import VAFContourDisplay

__all__ = [
    "BodeDisplay",
    "DelayLossDisplay",
    "ForgettingProfileDisplay",
    "MemoryHorizonDisplay",
    "OperatorParametersDisplay",
    "ParameterPathDisplay",
    "SimulationDisplay",
    "TrackingDisplay",
    "VAFContourDisplay",
]
