"""Monte-Carlo studies: seeded, resumable, on any number of workers."""

from .blocks import Block, DataSet
from .declared import identified_as
from .statistics import summarize
from .study import MonteCarloStudy

__all__ = ["Block", "DataSet", "MonteCarloStudy", "identified_as", "summarize"]
