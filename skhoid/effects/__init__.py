"""Named physical effects, which models take and searches try."""

from .actuator import Backlash, HardeningStiffness, Quantised, RateLimit, Saturation, Stiction
from .base import Effect, Parameter
from .catalogue import catalogue, effect
from .composition import Effects
from .dynamics import ExtraLag, ExtraLead, HigherOrder, NeuromuscularMode
from .error_scan import ErrorScan
from .input_maps import AbsoluteValue, AsymmetricGain, CubicGain, DeadZone, Rectified
from .intermittent import Intermittent
from .offsets import Bias, Drift, Integral
from .paths import CrossAxis, Disturbance, Feedforward, MotionFeedback, OutputFeedback, Preview
from .time_variation import GainDrift, Lapses, ScheduledGain, TimeVaryingGain
from .timing import TimeVaryingDelay, WrongDelay
from .traces import Signature
from .tremor import Tremor

__all__ = [
    "AbsoluteValue",
    "AsymmetricGain",
    "Backlash",
    "Bias",
    "CrossAxis",
    "CubicGain",
    "DeadZone",
    "Disturbance",
    "Drift",
    "Effect",
    "Effects",
    "ErrorScan",
    "ExtraLag",
    "ExtraLead",
    "Feedforward",
    "GainDrift",
    "HardeningStiffness",
    "HigherOrder",
    "Integral",
    "Intermittent",
    "Lapses",
    "MotionFeedback",
    "NeuromuscularMode",
    "OutputFeedback",
    "Parameter",
    "Preview",
    "Quantised",
    "RateLimit",
    "Rectified",
    "Saturation",
    "ScheduledGain",
    "Signature",
    "Stiction",
    "TimeVaryingDelay",
    "TimeVaryingGain",
    "Tremor",
    "WrongDelay",
    "catalogue",
    "effect",
]
