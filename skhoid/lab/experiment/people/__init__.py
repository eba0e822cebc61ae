"""Every person, condition and run of an experiment, identified in one call."""

from .identify import identify_people
from .result import PeopleResult

__all__ = ["PeopleResult", "identify_people"]
