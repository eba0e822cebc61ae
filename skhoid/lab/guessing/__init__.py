"""Which column of a file is which, and whose recording it is, where nobody has said so."""

from .columns import guess_columns as guess_columns
from .experiment import read_experiment
from .problems import ColumnGuess as ColumnGuess
from .problems import Problem as Problem
from .problems import UnclearColumnsError as UnclearColumnsError
from .reading import read_guessed as read_guessed
from .reading import read_runs

__all__ = ["read_experiment", "read_runs"]
