"""The errors and warnings a caller may want to catch, one class each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

__all__ = [
    "ColumnError",
    "Hinted",
    "IrregularSamplingError",
    "LongDelayWarning",
    "MissingDataWarning",
    "NothingExplainedWarning",
    "PooledRunsWarning",
    "PoorExcitationWarning",
    "RankDeficiencyError",
    "RemnantIntensityError",
    "RunCutWarning",
    "RunIndexError",
    "RunTimeWarning",
    "ShortRunError",
    "SlowClockWarning",
    "StudyFolderError",
    "StudyWarning",
    "UnstableLoopError",
    "UsageError",
    "WorkersLostError",
]


class Hinted(Exception):
    """What all errors and warnings of the package carry.

    Parameters
    ----------
    message : str
        What is wrong, where, and what was got.
    hint : str, default=""
        What one writes in Python about it; ``str(error)`` is the message and the hint.
    options : sequence of str or of (str, str), default=()
        Options of the command line that do the same, some with their values.
    """

    def __init__(
        self, message: str = "", hint: str = "", options: Sequence[str | tuple[str, str]] = ()
    ) -> None:
        super().__init__(f"{message} {hint}".strip())
        self.message = message
        self.hint = hint
        self.options = tuple(options)


class ColumnError(Hinted, ValueError):
    """A file does not have the column or variable that was asked for.

    Parameters
    ----------
    message : str
        What the file has instead.
    alone : str, default=""
        The same where the file is named already, without what else it has.
    """

    def __init__(self, message: str = "", alone: str = "") -> None:
        super().__init__(message)
        self.alone = alone or message


class UsageError(Hinted, ValueError):
    """Arguments do not fit the data or one another; the hint says what to give."""


class RunIndexError(Hinted, ValueError):
    """Rows, runs or indexes of ``X`` and ``y`` violate the data convention."""


class IrregularSamplingError(Hinted, ValueError):
    """The clock of a run is too irregular, or differs from the one of the fit."""


class ShortRunError(Hinted, ValueError):
    """A run has fewer rows than the model's lags need."""


class RankDeficiencyError(Hinted, ValueError):
    """The regressors are linearly dependent; the message names the cause."""


class UnstableLoopError(Hinted, ValueError):
    """A simulated loop is unstable."""


class RemnantIntensityError(Hinted, ValueError):
    """No remnant gain gives the requested intensity, or the realisations do not determine it."""


class StudyFolderError(Hinted, ValueError):
    """A folder belongs to a different study, or to none."""


class WorkersLostError(Hinted, RuntimeError):
    """The workers of a study died repeatedly; what was finished is kept."""


class StudyWarning(Hinted, UserWarning):
    """Part of a study had to be recomputed, or data sets failed."""


class MissingDataWarning(Hinted, UserWarning):
    """Rows with missing values were left out, or held, and counted."""


class PoorExcitationWarning(Hinted, UserWarning):
    """The data do not determine all parameters; some keep their previous values."""


class RunCutWarning(Hinted, UserWarning):
    """A split has rows of one run on both sides, or drew rows of an array one by one."""


class PooledRunsWarning(Hinted, UserWarning):
    """Runs of several subjects or conditions are fitted as if from one operator."""


class SlowClockWarning(Hinted, UserWarning):
    """The clock is too slow for a person: it may count milliseconds, or rows."""


class LongDelayWarning(Hinted, UserWarning):
    """A delay in seconds is longer than a person's: it may be a number of samples."""


class NothingExplainedWarning(Hinted, UserWarning):
    """The best candidate of a search explains nothing of the held-out output."""


class RunTimeWarning(Hinted, UserWarning):
    """Sampling instants jitter, or runs that should share a time axis do not."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest known one, if one is near."""
    near = get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" Did you mean {near[0]!r}?" if near else ""
