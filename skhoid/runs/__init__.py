"""Runs, time, marks and roles: the data convention, defined here for the whole package."""

from .layout import BY_RUNS as BY_RUNS
from .layout import GAP as GAP
from .layout import SET_OUTPUT_HINT as SET_OUTPUT_HINT
from .layout import WHOLE as WHOLE
from .layout import RunLayout as RunLayout
from .layout import check_alignment as check_alignment
from .layout import check_increasing as check_increasing
from .layout import check_levels as check_levels
from .layout import check_pieces as check_pieces
from .layout import contiguous_runs as contiguous_runs
from .layout import empty_runs as empty_runs
from .layout import numbered as numbered
from .layout import read_layout as read_layout
from .layout import rows_of_runs as rows_of_runs
from .layout import run_index as run_index
from .layout import run_name as run_name
from .layout import run_time_index as run_time_index
from .layout import snap as snap
from .layout import time_in_seconds as time_in_seconds
from .layout import whole_samples as whole_samples
from .layout import within_runs as within_runs
from .roles import RUN as RUN
from .roles import TIME as TIME
from .roles import input_columns as input_columns
from .roles import of_person as of_person
from .roles import output_name as output_name
from .roles import role_of as role_of
from .roles import roles_of as roles_of
from .roles import run_column as run_column
from .selection import run_labels, sampling_time, select_runs
from .selection import warn_of_pooled as warn_of_pooled
from .tables import JITTER_TOLERANCE as JITTER_TOLERANCE
from .tables import DecimationMark as DecimationMark
from .tables import as_frame as as_frame
from .tables import fingerprint_of as fingerprint_of
from .tables import is_mark as is_mark
from .tables import mark_decimated as mark_decimated
from .tables import mark_run_column as mark_run_column
from .tables import mark_run_in as mark_run_in
from .tables import refuse_container as refuse_container
from .tables import refuse_flat as refuse_flat

__all__ = ["run_labels", "sampling_time", "select_runs"]
