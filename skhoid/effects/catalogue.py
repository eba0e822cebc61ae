"""All effects that a search tries."""

from __future__ import annotations

import pandas as pd

from ..exceptions import did_you_mean
from .actuator import Backlash, HardeningStiffness, Quantised, RateLimit, Saturation, Stiction
from .base import Effect
from .dynamics import ExtraLag, ExtraLead, HigherOrder, NeuromuscularMode
from .input_maps import AbsoluteValue, AsymmetricGain, CubicGain, DeadZone, Rectified
from .intermittent import Intermittent
from .offsets import Bias, Drift, Integral
from .paths import CrossAxis, Disturbance, Feedforward, MotionFeedback, OutputFeedback, Preview
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
    Tremor,
)
BY_NAME = {c.name: c for c in CLASSES}


def effect(name: str) -> Effect:
    """The effect of an id, with everything to be estimated.

    Parameters
    ----------
    name : str
        Id, such as ``"dead_zone"``.

    Returns
    -------
    effect : Effect

    Examples
    --------
    >>> from skhoid.effects import effect
    >>> effect("dead_zone")
    DeadZone()
    """
    if name not in BY_NAME:
        raise ValueError(
            f"No effect is called {name!r}. There are: {', '.join(BY_NAME)}."
            f"{did_you_mean(name, BY_NAME)}"
        )
    return BY_NAME[name]()


def catalogue() -> pd.DataFrame:
    """The catalogue as a table.

    Returns
    -------
    table : DataFrame
        One row an effect, indexed by its id: class, place, physics, formula, source.

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
                "class": c.__name__,
                "place": c().place,
                "physics": c.physics,
                "formula": c.formula,
                "source": c.source,
            }
            for c in CLASSES
        ]
    ).set_index("effect")
