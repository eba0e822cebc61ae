"""DelayShift: delay the inputs, at the full sampling rate."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np

from .._sklearn import DT, Interval
from ..exceptions import ShortRunError
from ..runs import RunLayout, input_columns, whole_samples
from .base import RowPreservingTransformer, as_fitted


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
        Channels to shift. None means the column named ``e`` if there is one, else all.
    roles : dict or None, default=None
        Roles of columns, ``{column: role}``; a column of role ``e`` is the input.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index; it passes through unchanged.

    Attributes
    ----------
    n_samples_ : int
        Delay in samples of the full rate.
    delay_ : float
        Delay in seconds after rounding to whole samples.
    dt_ : float
        Sampling time in seconds.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

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
                f"{lengths[run] * layout.dt:g} s."
            )
        self.n_samples_ = round(whole_samples(self.delay, layout.dt))
        self.delay_ = self.n_samples_ * layout.dt

    def transform(self, X: Any) -> Any:
        """Shift the input channels.

        Parameters
        ----------
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.

        Returns
        -------
        X_shifted : same container as X, shape (n_rows, n_columns)
        """
        layout, values = self._read(X, reset=False)
        columns = shifted_columns(self)
        shift = self.n_samples_
        shifted = values.copy()
        for a, b in zip(layout.starts[:-1], layout.starts[1:], strict=True):
            cut = min(a + shift, b)
            shifted[a:cut, columns] = np.nan
            shifted[cut:b, columns] = values[a : a + b - cut, columns]
        return self._like_input(X, shifted)


def shifted_columns(step: DelayShift) -> list[int]:
    """Positions of the columns that a fitted step shifts."""
    told = as_fitted(step)
    return input_columns(step._names, step.n_features_in_, told.inputs, step._run, told.roles)
