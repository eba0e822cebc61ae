"""Every picture: one Display per file, in the pattern of scikit-learn."""

from .delay_loss import DelayLossDisplay
from .simulation import SimulationDisplay
from .tracking import TrackingDisplay
from .vaf_contour import VAFContourDisplay

__all__ = ["DelayLossDisplay", "SimulationDisplay", "TrackingDisplay", "VAFContourDisplay"]
