"""Monte-Carlo studies: seeded, resumed, on any number of workers."""

from .blocks import Block, DataSet
from .statistics import summarize
from .study import MonteCarloStudy

__all__ = ["Block", "DataSet", "MonteCarloStudy", "summarize"]
