"""Named physical effects, which models include and searches try."""

from .actuator import Backlash, HardeningStiffness, Quantised, RateLimit, Saturation, Stiction
from .base import Effect
from .catalogue import catalogue  # which fills the registry of ids
from .composition import Effects
from .core_kind import CoreKind
from .dimension import Dimension
from .dynamics import ExtraLag, ExtraLead, HigherOrder, NeuromuscularMode
from .error_scan import ErrorScan
from .free_form import FreeForm
from .free_hysteresis import FreeHysteresis
from .free_map import FreeMap
from .free_path import FreeDynamics, FreePath
from .free_variation import FreeDelay, FreeGain, FreeOffset
from .input_maps import AbsoluteValue, AsymmetricGain, CubicGain, DeadZone, Rectified
from .inside import Friction, RootFlow, Stops
from .intermittent import Intermittent
from .offsets import Bias, Drift, Integral
from .parameter import Parameter
from .paths import CrossAxis, Disturbance, Feedforward, MotionFeedback, OutputFeedback, Preview
from .reflex import RateReflex
from .registry import effect, title_of, titles_of
from .scheduled import InputFilter, ScheduledDynamics
from .sensor import SensorMagnitude
from .time_variation import GainDrift, Lapses, ScheduledGain, TimeVaryingGain
from .timing import TimeVaryingDelay, WrongDelay
from .traces import Signature
from .tremor import Tremor

__all__ = [
    "AbsoluteValue",
    "AsymmetricGain",
    "Backlash",
    "Bias",
    "CoreKind",
    "CrossAxis",
    "CubicGain",
    "DeadZone",
    "Dimension",
    "Disturbance",
    "Drift",
    "Effect",
    "Effects",
    "ErrorScan",
    "ExtraLag",
    "ExtraLead",
    "Feedforward",
    "FreeDelay",
    "FreeDynamics",
    "FreeForm",
    "FreeGain",
    "FreeHysteresis",
    "FreeMap",
    "FreeOffset",
    "FreePath",
    "Friction",
    "GainDrift",
    "HardeningStiffness",
    "HigherOrder",
    "InputFilter",
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
    "RateReflex",
    "Rectified",
    "RootFlow",
    "Saturation",
    "ScheduledDynamics",
    "ScheduledGain",
    "SensorMagnitude",
    "Signature",
    "Stiction",
    "Stops",
    "TimeVaryingDelay",
    "TimeVaryingGain",
    "Tremor",
    "WrongDelay",
    "catalogue",
    "effect",
    "title_of",
    "titles_of",
]
