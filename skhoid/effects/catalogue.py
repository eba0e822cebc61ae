"""The catalogue: all effects that a search tries, as a list and as a table."""

from __future__ import annotations

import pandas as pd

from .base import Effect
from .free_form import FreeForm
from .free_forms import (
    FreeDelay,
    FreeDynamics,
    FreeGain,
    FreeHysteresis,
    FreeMap,
    FreeOffset,
    FreePath,
)
from .in_time import (
    GainDrift,
    Intermittent,
    Lapses,
    ScheduledGain,
    TimeVaryingDelay,
    TimeVaryingGain,
    WrongDelay,
)
from .machines import (
    Friction,
    InputFilter,
    RateReflex,
    RootFlow,
    ScheduledDynamics,
    SensorMagnitude,
    Stops,
)
from .maps import (
    AbsoluteValue,
    AsymmetricGain,
    Backlash,
    CubicGain,
    DeadZone,
    HardeningStiffness,
    Quantised,
    RateLimit,
    Rectified,
    Saturation,
    Stiction,
)
from .paths import (
    Bias,
    CrossAxis,
    Disturbance,
    Drift,
    ExtraLag,
    ExtraLead,
    Feedforward,
    HigherOrder,
    Integral,
    MotionFeedback,
    NeuromuscularMode,
    OutputFeedback,
    Preview,
)
from .registry import register, title_of
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
