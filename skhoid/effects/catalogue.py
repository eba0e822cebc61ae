"""The catalogue: all effects that a search tries, as a list and as a table."""

from __future__ import annotations

import pandas as pd

from .actuator import Backlash, HardeningStiffness, Quantised, RateLimit, Saturation, Stiction
from .base import Effect
from .dynamics import ExtraLag, ExtraLead, HigherOrder, NeuromuscularMode
from .free_form import FreeForm
from .free_hysteresis import FreeHysteresis
from .free_map import FreeMap
from .free_path import FreeDynamics, FreePath
from .free_variation import FreeDelay, FreeGain, FreeOffset
from .input_maps import AbsoluteValue, AsymmetricGain, CubicGain, DeadZone, Rectified
from .inside import Friction, RootFlow, Stops
from .intermittent import Intermittent
from .offsets import Bias, Drift, Integral
from .paths import CrossAxis, Disturbance, Feedforward, MotionFeedback, OutputFeedback, Preview
from .reflex import RateReflex
from .registry import register, title_of
from .scheduled import InputFilter, ScheduledDynamics
from .sensor import SensorMagnitude
from .time_variation import GainDrift, Lapses, ScheduledGain, TimeVaryingGain
from .timing import TimeVaryingDelay, WrongDelay
from .tremor import Tremor

CLASSES: tuple[type[Effect], ...] = (
    WrongDelay,
    TimeVaryingDelay,
    Intermittent,
    TimeVaryingGain,
    GainDrift,
    Lapses,
    ScheduledGain,
    DeadZone,
    AsymmetricGain,
    Rectified,
    CubicGain,
    AbsoluteValue,
    Saturation,
    RateLimit,
    Backlash,
    Stiction,
    Quantised,
    HardeningStiffness,
    Bias,
    Drift,
    Integral,
    Feedforward,
    Preview,
    OutputFeedback,
    MotionFeedback,
    Disturbance,
    CrossAxis,
    ExtraLag,
    ExtraLead,
    NeuromuscularMode,
    HigherOrder,
    Friction,
    RootFlow,
    Stops,
    SensorMagnitude,
    InputFilter,
    RateReflex,
    ScheduledDynamics,
    Tremor,
)
BY_NAME = register(CLASSES)
# Tried where no effect with a name fits; no search takes them for names.
FREE_FORMS: tuple[type[FreeForm], ...] = (
    FreeMap,
    FreeHysteresis,
    FreeGain,
    FreeDelay,
    FreeOffset,
    FreePath,
    FreeDynamics,
)
register(FREE_FORMS)


def catalogue() -> pd.DataFrame:
    """The catalogue as a table.

    Returns
    -------
    table : DataFrame
        One row per effect, indexed by its id: title, class, place, physics, formula, source.

    Examples
    --------
    >>> from skhoid.effects import catalogue
    >>> catalogue().loc["saturation", "place"]
    'output'
    """
    return pd.DataFrame(
        [
            {
                "effect": c.name,
                "title": title_of(c.name),
                "class": c.__name__,
                "place": c().place,
                "physics": c.physics,
                "formula": c.formula,
                "source": c.source,
            }
            for c in CLASSES
        ]
    ).set_index("effect")
