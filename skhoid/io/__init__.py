"""Recorded runs from files, and real recordings that come with the package."""

# What the rooms above use, and no user needs.
from ._formats import READERS as READERS
from ._formats import open_table as open_table
from ._likeness import numbers_of as numbers_of
from ._paths import expand_paths as expand_paths
from ._paths import shown as shown
from ._table import FileTable as FileTable
from ._table import require as require
from ._table import split_header as split_header
from .datasets import load_bicycle_rider, load_human_tracking
from .experiments import read_experiment
from .figures import save_figure as save_figure
from .guess import ColumnGuess as ColumnGuess
from .guess import Problem as Problem
from .guess import UnclearColumnsError as UnclearColumnsError
from .guess import guess_columns as guess_columns
from .readers import first_table as first_table
from .readers import read_guessed as read_guessed
from .readers import read_runs
from .tables import check_table_format as check_table_format
from .tables import write_tables as write_tables
from .whole import written_whole as written_whole
from .writers import write_runs

__all__ = [
    "load_bicycle_rider",
    "load_human_tracking",
    "read_experiment",
    "read_runs",
    "write_runs",
]
