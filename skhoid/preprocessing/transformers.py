"""Decimator, DelayShift and RunInTrimmer: transformers that keep every row."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any

import numpy as np

from .._sklearn import DT, RUN_IN, Interval, StrOptions
from ..exceptions import LongDelayWarning, RunIndexError, ShortRunError, UsageError
from ..runs import (
    DecimationMark,
    RunLayout,
    input_columns,
    mark_decimated,
    mark_run_in,
    whole_samples,
)
from ..runs.roles import of_person, roles_of
from .base import RowPreservingTransformer, as_fitted
from .grid import METHODS, PADDINGS, lowpass

LONGEST = 1.5  # s, of a person; the highest tau_e that OperatorRegressor estimates


class Decimator(RowPreservingTransformer):
    """Decimate recorded runs by a whole factor without dropping a row.

    The channels are low-pass filtered inside each run, and the rows that a decimated recording
    would keep are marked in an extra index level. skhoid's estimators respect the mark: they filter
    and thin ``y`` in the same way, fit on the kept rows, and interpolate predictions back to every
    row. Standard scikit-learn pipelines and searches therefore work, and scores are at full rate.

    Parameters
    ----------
    factor : int, default=1
        Decimation factor d: every d-th row is kept. With 1, nothing is changed or marked.
    method : {"ideal", "downsample", "aggregate"}, default="ideal"
        ``"ideal"`` is the noncausal FFT filter that removes everything from the new Nyquist
        frequency on; ``"downsample"`` thins without a filter; ``"aggregate"`` is piecewise
        aggregate approximation, the mean of each block of ``factor`` rows.
    padding : {"odd", "periodic"}, default="odd"
        What the ideal filter assumes beyond the ends of a run. ``"odd"`` reflects the run about its
        end points. ``"periodic"`` is the plain DFT: exact when the measurement window holds whole
        periods of the forcing function (trim the run-in before decimating). Other runs end at a
        different value than they began, ring near both ends, and bias the model: b0 of an ARX model
        by a quarter in runs of 82 s with 6 s left out.
    {dt, run}

    Attributes
    ----------
    dt_ : float
        Sampling time in seconds before decimation.
    {n_features_in_, feature_names_in_}

    See Also
    --------
    DelayShift : Shifts at the full rate, whether it comes before or after the Decimator.

    Notes
    -----
    Row k of a run (counted from time zero, so slicing a run does not change the choice) is kept if
    k is a multiple of d. Filters do not cross runs, gaps or the end of a run-in marked by
    :class:`RunInTrimmer`. NaN are bridged for filtering but stay NaN.

    References
    ----------
    Van Grootheest, thesis, Section III-D step 8a and Section 4.2.2.

    Examples
    --------
    >>> from skhoid import Decimator, load_bicycle_rider
    >>> X, y = load_bicycle_rider()
    >>> Xd = Decimator(factor=4).fit_transform(X)
    >>> len(Xd) == len(X)
    True
    >>> list(Xd.index.names)
    ['run', 'time', 'decimation 1/4 ideal odd']
    """

    _parameter_constraints: dict = {
        "factor": [Interval(Integral, 1, None, closed="left")],
        "method": [StrOptions(set(METHODS))],
        "padding": [StrOptions(set(PADDINGS))],
        "dt": DT,
        "run": "no_validation",
    }

    def __init__(
        self,
        factor: int = 1,
        *,
        method: str = "ideal",
        padding: str = "odd",
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.factor = factor
        self.method = method
        self.padding = padding
        self.dt = dt
        self.run = run

    def _check_layout(self, layout: RunLayout) -> None:
        factor = as_fitted(self).factor
        if layout.mark is not None and factor > 1:
            raise RunIndexError(
                f"X is already decimated by {layout.mark.factor}; use one Decimator with factor="
                f"{layout.mark.factor * factor}."
            )

    def transform(self, X: Any) -> Any:
        """Filter the channels and mark the rows that stay.

        Parameters
        ----------
        {X}

        Returns
        -------
        X_marked : DataFrame of shape (n_rows, n_columns)
            Filtered channels; the last index level is True in kept rows. With ``factor=1``, ``X``
            unchanged in its own container.
        """
        layout, values = self._read(X, reset=False)
        self._check_layout(layout)
        told = as_fitted(self)
        if told.factor == 1:
            return self._like_input(X, values)
        mark = DecimationMark(told.factor, told.method, told.padding)
        columns = self._channels(values.shape[1])
        filtered = values.copy()
        filtered[:, columns] = lowpass(values[:, columns], layout.stretches, mark)
        kept = layout.sample_numbers() % told.factor == 0
        return mark_decimated(self._frame(X, filtered, layout), mark, np.asarray(kept))


class DelayShift(RowPreservingTransformer):
    """Delay the input channels by a fixed time, inside each run.

    The shift is made at the full sampling rate, whether a :class:`Decimator` comes before or after
    it, so the delay keeps the resolution of the recording. The first rows of a run have no past and
    become NaN, which skhoid's estimators leave out. Rows of a trimmed run-in are recorded past and
    are used.

    Parameters
    ----------
    delay : float, default=0.0
        Delay in seconds, rounded to the nearest whole sample. It includes the sample that
        zero-order hold adds: 0.29 s for an operator with tau_e = 0.28 s at 100 Hz.
    inputs : list of column names or positions, or None, default=None
        Channels to shift. None means the column of role ``e`` if there is one, else all.
    {roles, dt, run}

    Attributes
    ----------
    n_samples_ : int
        Delay in samples of the full rate.
    delay_ : float
        Delay in seconds after rounding to whole samples.
    {dt_}
    {n_features_in_, feature_names_in_}

    References
    ----------
    Van Grootheest, thesis, Section III-D step 4: shift first, then thin, with the offset ceil(n_k /
    d) d - n_k, which follows from keeping the grid of ``y``.

    Examples
    --------
    >>> from skhoid import DelayShift, load_bicycle_rider
    >>> X, y = load_bicycle_rider()
    >>> shifted = DelayShift(delay=0.1).fit_transform(X)
    >>> bool((shifted["RollAngle"].to_numpy()[20:] == X["RollAngle"].to_numpy()[:-20]).all())
    True
    """

    _parameter_constraints: dict = {
        "delay": [Interval(Real, 0, None, closed="left")],
        "inputs": "no_validation",
        "roles": [dict, None],
        "dt": DT,
        "run": "no_validation",
    }

    def __init__(
        self,
        delay: float = 0.0,
        *,
        inputs: Any = None,
        roles: dict | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.delay = delay
        self.inputs = inputs
        self.roles = roles
        self.dt = dt
        self.run = run

    def _check_layout(self, layout: RunLayout) -> None:
        lengths = np.diff(layout.run_starts)
        if round(whole_samples(self.delay, layout.dt)) >= lengths.min(initial=layout.n_rows + 1):
            run = int(np.argmin(lengths))
            raise ShortRunError(
                f"delay={self.delay:g} s is longer than run {layout.labels[run]!r}, which lasts "
                f"{lengths[run] * layout.dt:g} s. It is in seconds: {self.delay:g} samples, as nk "
                f"counts them, are delay={self.delay * layout.dt:g}."
            )
        names = self._reading.names or []
        doubt_long_delay(self.delay, layout.dt, roles_of(names, self.roles).values())
        self.n_samples_ = round(whole_samples(self.delay, layout.dt))
        self.delay_ = self.n_samples_ * layout.dt

    def transform(self, X: Any) -> Any:
        """Shift the input channels.

        Parameters
        ----------
        {X}

        Returns
        -------
        X_shifted : same container as X, shape (n_rows, n_columns)
        """
        layout, values = self._read(X, reset=False)
        columns = self.shifted_columns
        shift = self.n_samples_
        shifted = values.copy()
        for a, b in zip(layout.starts[:-1], layout.starts[1:], strict=True):
            cut = min(a + shift, b)
            shifted[a:cut, columns] = np.nan
            shifted[cut:b, columns] = values[a : a + b - cut, columns]
        return self._like_input(X, shifted)

    @property
    def shifted_columns(self) -> list[int]:
        """Positions of the columns that the fitted step shifts."""
        told, read = as_fitted(self), self._reading
        return input_columns(read.names, self.n_features_in_, told.inputs, read.run, told.roles)


def doubt_long_delay(delay: Any, dt: float, roles: Iterable[str]) -> None:
    """Warn of a delay in seconds that may be meant in samples.

    That is an integer where a sample is not a second, and one which no person has where the
    channels have the roles of a person's; a machine may have any.
    """
    roles = list(roles)
    far = delay > LONGEST and (of_person(roles) or ("e" in roles and float(delay).is_integer()))
    if dt == 1.0 or delay == 0 or not (far or isinstance(delay, Integral)):
        return
    why = f"; people take up to {LONGEST:g} s" if far else ""
    warnings.warn(
        LongDelayWarning(
            f"delay={delay!r} is in seconds, and {delay / dt:.6g} samples of {dt:g} s{why}.",
            hint=f"If it is a number of samples, as nk is, give delay={delay * dt:g}; if it is "
            f"seconds, say so by delay={float(delay)!r}"
            f"{', and ignore this by its class, LongDelayWarning' if far else ''}.",
        ),
        stacklevel=2,
    )


class RunInTrimmer(RowPreservingTransformer):
    """Mark the run-in of each run, so that estimators and scorers leave it out.

    skhoid's estimators do not fit marked rows. Their simulation restarts at the first row after the
    run-in, with zero output and the recorded past inputs; the run-in itself gets the free run from
    the start of the recording. Scores exclude the run-in.

    Parameters
    ----------
    run_in : float or None, default=None
        Length of the run-in in seconds, counted from the first row of each run.
    measurement_time : float or None, default=None
        Length of the measurement window T_m in seconds; the last ``measurement_time`` of each run
        is kept. Give at most one of the two; with neither, nothing is marked.
    {dt, run}

    Attributes
    ----------
    {dt_}
    {n_features_in_, feature_names_in_}

    Notes
    -----
    Put it before the :class:`Decimator`, so that only the measurement window is filtered. The start
    of the free run matters: on the thesis's remnant-free data ARX[2,2,28] scores a VAF of 99.9553 %
    on the second half when it starts with the window, and 98.9605 % when it starts in the middle.

    References
    ----------
    Van Grootheest, thesis, Section III-D step 1.

    Examples
    --------
    >>> from skhoid import RunInTrimmer, load_bicycle_rider
    >>> X, y = load_bicycle_rider()
    >>> marked = RunInTrimmer(run_in=5.0).fit_transform(X)
    >>> int(marked.index.get_level_values("run-in").to_numpy().sum())
    1000
    """

    _parameter_constraints: dict = {
        "run_in": RUN_IN,
        "measurement_time": [Interval(Real, 0, None, closed="neither"), None],
        "dt": DT,
        "run": "no_validation",
    }

    def __init__(
        self,
        run_in: float | None = None,
        *,
        measurement_time: float | None = None,
        dt: float | None = None,
        run: Any = None,
    ) -> None:
        self.run_in = run_in
        self.measurement_time = measurement_time
        self.dt = dt
        self.run = run

    def _check_layout(self, layout: RunLayout) -> None:
        if layout.mark is not None:
            raise RunIndexError(
                "X is already decimated, and the filter ran across the run-in. Put RunInTrimmer "
                "before the Decimator."
            )
        if self.run_in is not None and self.measurement_time is not None:
            raise UsageError(
                "The run-in (discard the first seconds) and the measurement time (keep the last "
                "seconds) are both given.",
                hint="Give run_in= or measurement_time=, not both.",
                options=["run_in", "measurement_time"],
            )

    def transform(self, X: Any) -> Any:
        """Mark the run-in in an extra index level.

        Parameters
        ----------
        {X}

        Returns
        -------
        X_marked : DataFrame of shape (n_rows, n_columns)
            The same values; the last index level is True in the run-in. Without ``run_in`` and
            ``measurement_time``, ``X`` unchanged in its own container.
        """
        layout, values = self._read(X, reset=False)
        told = as_fitted(self)
        if told.run_in is None and told.measurement_time is None:
            return self._like_input(X, values)
        trimmed = run_in_rows(layout, run_in=told.run_in, measurement_time=told.measurement_time)
        return mark_run_in(self._frame(X, values, layout), trimmed)


def run_in_rows(
    layout: RunLayout, *, run_in: float | None = None, measurement_time: float | None = None
) -> np.ndarray:
    """Rows of the run-in, in whole samples counted from an end of each run."""
    for name, value in (("run_in", run_in), ("measurement_time", measurement_time)):
        if value is not None and not 0 <= value < np.inf:
            raise ValueError(f"{name} must be a time in seconds, 0 or more; got {value!r}.")
    trimmed = np.zeros(layout.n_rows, dtype=bool)
    for run, (a, b) in enumerate(zip(layout.run_starts[:-1], layout.run_starts[1:], strict=True)):
        number = np.rint((layout.time[a:b] - layout.time[a]) / layout.dt)
        if run_in is not None:
            part = number < whole_samples(run_in, layout.dt)
        elif measurement_time is not None:
            rows = round(whole_samples(measurement_time, layout.dt))
            if rows == 0:
                raise ValueError(
                    f"measurement_time={measurement_time:g} s is less than half the sampling time "
                    f"{layout.dt:g} s."
                )
            if number[-1] + 1 < rows:
                raise ShortRunError(
                    f"Run {layout.labels[run]!r} lasts {(number[-1] + 1) * layout.dt:g} s, less "
                    f"than measurement_time={measurement_time:g} s."
                )
            part = number < number[-1] + 1 - rows
        else:
            continue
        if part.all():
            raise ShortRunError(
                f"Run {layout.labels[run]!r} lasts {(number[-1] + 1) * layout.dt:g} s; a run-in "
                f"of {run_in:g} s leaves nothing of it."
            )
        trimmed[a:b] = part
    return trimmed
