"""The errors and warnings a caller may want to catch, one class each."""

from __future__ import annotations

__all__ = [
    "IrregularSamplingError",
    "MissingDataWarning",
    "PoorExcitationWarning",
    "RankDeficiencyError",
    "RemnantIntensityError",
    "RunCutWarning",
    "RunIndexError",
    "RunTimeWarning",
    "SamplingJitterWarning",
    "ShortRunError",
    "StudyFolderError",
    "StudyWarning",
    "UnstableLoopError",
    "WorkersLostError",
]


class RunIndexError(ValueError):
    """Rows, runs or indexes of ``X`` and ``y`` break the data convention."""


class IrregularSamplingError(ValueError):
    """The clock of a run is too irregular, or not the one the model was fitted at."""


class ShortRunError(ValueError):
    """A run has fewer rows than the model's lags need."""


class RankDeficiencyError(ValueError):
    """The regressors are linearly dependent; the message names the cause."""


class UnstableLoopError(ValueError):
    """A simulated loop is unstable."""


class RemnantIntensityError(ValueError):
    """No remnant gain gives the wanted intensity, or the realisations do not determine it."""


class StudyFolderError(ValueError):
    """A folder belongs to a different study, or to none."""


class WorkersLostError(RuntimeError):
    """The workers of a study died again and again; what was finished is kept."""


class StudyWarning(UserWarning):
    """Part of a study had to be computed again, or data sets failed."""


class SamplingJitterWarning(UserWarning):
    """The sampling instants jitter, within the tolerance."""


class MissingDataWarning(UserWarning):
    """Rows with missing values were left out, or held, and counted."""


class PoorExcitationWarning(UserWarning):
    """The data do not determine all parameters; some stay where they were."""


class RunCutWarning(UserWarning):
    """A cross-validation split has rows of one run on both sides."""


class RunTimeWarning(UserWarning):
    """Runs that should share their time in the run do not."""
