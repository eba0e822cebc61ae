"""The errors and warnings a caller may want to catch, one class each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

__all__ = [
    "ColumnError",
    "Hinted",
    "IrregularSamplingError",
    "MissingDataWarning",
    "PooledRunsWarning",
    "PoorExcitationWarning",
    "RankDeficiencyError",
    "RemnantIntensityError",
    "RunCutWarning",
    "RunIndexError",
    "RunTimeWarning",
    "SamplingJitterWarning",
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

    Examples
    --------
    >>> from skhoid.exceptions import UsageError
    >>> error = UsageError("There is no clock.", hint="Give dt=0.01.", options=["dt"])
    >>> error.message, str(error)
    ('There is no clock.', 'There is no clock. Give dt=0.01.')
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

    Examples
    --------
    >>> from skhoid.exceptions import ColumnError
    >>> error = ColumnError("run1.csv has no column 'e'. It has: 't', 'u'.", "There is no 'e'.")
    >>> error.alone
    "There is no 'e'."
    """

    def __init__(self, message: str = "", alone: str = "") -> None:
        super().__init__(message)
        self.alone = alone or message


class UsageError(Hinted, ValueError):
    """Arguments do not fit the data or one another; the hint says what to give.

    Examples
    --------
    >>> from skhoid import make_tracking_runs, performance_scores
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> performance_scores(X.rename(columns={"e": "other"}), None)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.UsageError: There is nothing to score: ...
    """


class RunIndexError(Hinted, ValueError):
    """Rows, runs or indexes of ``X`` and ``y`` violate the data convention.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> ARXRegressor().fit(X[::-1], y[::-1])
    Traceback (most recent call last):
        ...
    skhoid.exceptions.RunIndexError: The rows are shuffled: time goes backwards ...
    """


class IrregularSamplingError(Hinted, ValueError):
    """The clock of a run is too irregular, or differs from the one of the fit.

    Examples
    --------
    >>> from skhoid import sampling_time, make_tracking_runs
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> sampling_time(X[:1])
    Traceback (most recent call last):
        ...
    skhoid.exceptions.IrregularSamplingError: The sampling time cannot be read from the index: ...
    """


class ShortRunError(Hinted, ValueError):
    """A run has fewer rows than the model's lags need.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> ARXRegressor(nk=15).fit(X[:10], y[:10])
    Traceback (most recent call last):
        ...
    skhoid.exceptions.ShortRunError: Run 0 has at most 10 successive rows ...
    """


class RankDeficiencyError(Hinted, ValueError):
    """The regressors are linearly dependent; the message names the cause.

    Examples
    --------
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> ARXRegressor(inputs=["e", "half"]).fit(X.assign(half=X["e"] / 2), y)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.RankDeficiencyError: The 6 parameters cannot all be estimated: ...
    """


class UnstableLoopError(Hinted, ValueError):
    """A simulated loop is unstable.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> make_tracking_runs(perturbation={"K_e": 9.0}, random_state=0)  # a far too high gain
    Traceback (most recent call last):
        ...
    skhoid.exceptions.UnstableLoopError: The loop is unstable: ...
    """


class RemnantIntensityError(Hinted, ValueError):
    """No remnant gain gives the requested intensity, or the realisations do not determine it.

    Examples
    --------
    >>> from skhoid import make_tracking_runs
    >>> make_tracking_runs(remnant_intensity=0.9, random_state=0)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.RemnantIntensityError: No gain gives P_n = 0.9. ...
    """


class StudyFolderError(Hinted, ValueError):
    """A folder belongs to a different study, or to none.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> from skhoid import MonteCarloStudy
    >>> folder = Path(mkdtemp())
    >>> _ = (folder / "notes.txt").write_text("not a study")
    >>> study = MonteCarloStudy(
    ...     lambda data: {"sd": data.y.std()}, {"condition": ["C1"]}, n_replications=1
    ... )
    >>> study.run(folder)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.StudyFolderError: The folder ... does not belong to a study: ...
    """


class WorkersLostError(Hinted, RuntimeError):
    """The workers of a study died repeatedly; what was finished is kept.

    Examples
    --------
    >>> from skhoid import MonteCarloStudy
    >>> from skhoid.exceptions import WorkersLostError
    >>> study = MonteCarloStudy(
    ...     lambda data: {"sd": data.y.std()}, {"condition": ["C1"]}, n_replications=2
    ... )
    >>> try:
    ...     found = study.run()  # n_jobs=8, say, on a machine whose memory may not suffice
    ... except WorkersLostError as error:
    ...     print(error)
    >>> len(found)
    2
    """


class StudyWarning(Hinted, UserWarning):
    """Part of a study had to be recomputed, or data sets failed.

    Examples
    --------
    >>> import warnings
    >>> from skhoid import MonteCarloStudy
    >>> from skhoid.exceptions import StudyWarning
    >>> study = MonteCarloStudy(
    ...     lambda data: {"sd": data.y.std()}, {"remnant_intensity": [0.1, 0.9]}, n_replications=1
    ... )
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", StudyWarning)
    ...     study.run()
    Traceback (most recent call last):
        ...
    skhoid.exceptions.StudyWarning: 1 of 2 data sets failed; ...
    """


class SamplingJitterWarning(Hinted, UserWarning):
    """The sampling instants jitter, but within the tolerance.

    Examples
    --------
    >>> import warnings
    >>> import numpy as np
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.exceptions import SamplingJitterWarning
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> jitter = 6e-4 * np.sin(1.7 * np.arange(len(X)))  # s
    >>> shaken = X.reset_index("time")
    >>> shaken["time"] += jitter
    >>> shaken = shaken.set_index("time", append=True)
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", SamplingJitterWarning)
    ...     ARXRegressor().fit(shaken, y.set_axis(shaken.index))
    Traceback (most recent call last):
        ...
    skhoid.exceptions.SamplingJitterWarning: The sampling instants jitter by up to ...
    """


class MissingDataWarning(Hinted, UserWarning):
    """Rows with missing values were left out, or held, and counted.

    Examples
    --------
    >>> import warnings
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.exceptions import MissingDataWarning
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", MissingDataWarning)
    ...     ARXRegressor().fit(X, y.mask(y > 0.9 * y.max()))
    Traceback (most recent call last):
        ...
    skhoid.exceptions.MissingDataWarning: 12 rows of 'u' are NaN, ...
    """


class PoorExcitationWarning(Hinted, UserWarning):
    """The data do not determine all parameters; some keep their previous values.

    Examples
    --------
    >>> import warnings
    >>> from skhoid import RecursiveARX, make_tracking_runs
    >>> from skhoid.exceptions import PoorExcitationWarning
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> X[X.index.get_level_values("time") < 2] = 0.0  # nothing to see at first
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", PoorExcitationWarning)
    ...     RecursiveARX(init_window=1.0).fit(X, y)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.PoorExcitationWarning: ...
    """


class RunCutWarning(Hinted, UserWarning):
    """A cross-validation split has rows of one run on both sides.

    Examples
    --------
    >>> import warnings
    >>> from sklearn.model_selection import KFold
    >>> from skhoid import OrderSearchCV, make_tracking_runs
    >>> from skhoid.exceptions import RunCutWarning
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", RunCutWarning)
    ...     OrderSearchCV(na=[2], nb=[2], nk=[15], cv=KFold(3)).fit(X, y)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.RunCutWarning: The splits of cv=KFold(...) cut run 0: ...
    """


class PooledRunsWarning(Hinted, UserWarning):
    """Runs of several subjects or conditions are fitted as if from one operator.

    Examples
    --------
    >>> import warnings
    >>> import pandas as pd
    >>> from skhoid import ARXRegressor, make_tracking_runs
    >>> from skhoid.exceptions import PooledRunsWarning
    >>> runs = {s: make_tracking_runs(n_runs=1, random_state=s) for s in (1, 2)}
    >>> X, y = (pd.concat({s: runs[s][i] for s in runs}, names=["subject"]) for i in (0, 1))
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", PooledRunsWarning)
    ...     ARXRegressor(2, 2, 29).fit(X, y)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.PooledRunsWarning: Runs of 2 subjects are fitted as those of one: ...
    """


class SlowClockWarning(Hinted, UserWarning):
    """The clock is too slow for a person: it may count milliseconds, or rows.

    Examples
    --------
    >>> import warnings
    >>> from skhoid import make_tracking_runs, sampling_time
    >>> from skhoid.exceptions import SlowClockWarning
    >>> X, y = make_tracking_runs(n_runs=1, channels=("e", "x"), random_state=0)
    >>> X.index = X.index.set_levels(X.index.levels[1] * 1000, level="time")
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", SlowClockWarning)
    ...     sampling_time(X)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.SlowClockWarning: The time index advances by 10 a row, ...
    """


class RunTimeWarning(Hinted, UserWarning):
    """Runs that should share a time axis do not.

    Examples
    --------
    >>> import warnings
    >>> from skhoid import RecursiveARX, make_tracking_runs
    >>> from skhoid.exceptions import RunTimeWarning
    >>> X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    >>> model = RecursiveARX(memory_time=5.0).fit(X, y)
    >>> later = X.set_axis(X.index.set_levels(X.index.levels[1] + 100, level="time"))
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", RunTimeWarning)
    ...     model.predict(later)
    Traceback (most recent call last):
        ...
    skhoid.exceptions.RunTimeWarning: Rows from run 0, t = 100 s (row 0) on lie outside ...
    """


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest known one, if one is near."""
    near = get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" Did you mean {near[0]!r}?" if near else ""
