"""Every picture: one Display per file, in the pattern of scikit-learn."""

from .bode import BodeDisplay
from .delay_loss import DelayLossDisplay
from .operator_parameters import OperatorParametersDisplay
from .simulation import SimulationDisplay
from .tracking import TrackingDisplay
from .vaf_contour import VAFContourDisplay

__all__ = [
    "BodeDisplay",
    "DelayLossDisplay",
    "OperatorParametersDisplay",
    "SimulationDisplay",
    "TrackingDisplay",
    "VAFContourDisplay",
]
