"""Recorded runs from files, and real recordings that come with the package."""

from .datasets import load_bicycle_rider, load_human_tracking

# What the lab uses, and no user needs.
from .files import FileTable as FileTable
from .files import expand_paths as expand_paths
from .files import numbers_of as numbers_of
from .files import require as require
from .files import shown as shown
from .files import split_header as split_header
from .reading import READERS as READERS
from .reading import first_table as first_table
from .reading import open_table as open_table
from .writing import check_table_format as check_table_format
from .writing import is_left_over as is_left_over
from .writing import save_figure as save_figure
from .writing import write_runs
from .writing import write_tables as write_tables
from .writing import written_whole as written_whole

__all__ = ["load_bicycle_rider", "load_human_tracking", "write_runs"]
