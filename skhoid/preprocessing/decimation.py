"""Decimator: decimation that keeps every row and marks those that stay."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np

from .._sklearn import DT, Interval, StrOptions
from ..exceptions import RunIndexError
from ..runs import DecimationMark, RunLayout, mark_decimated
from .base import RowPreservingTransformer, as_fitted
from .filters import METHODS, PADDINGS, lowpass


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
    padding : {"periodic", "odd"}, default="periodic"
        What the ideal filter assumes beyond the ends of a run. ``"periodic"`` is the plain DFT,
        exact when the measurement window holds whole periods of the forcing function (trim the
        run-in before decimating). ``"odd"`` reflects the run about its end points; use it for runs
        that end at a different value than they began, which otherwise ring near both ends.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index; it passes through unchanged.

    Attributes
    ----------
    dt_ : float
        Sampling time in seconds before decimation.
    n_features_in_ : int
        Number of columns seen in ``fit``.
    feature_names_in_ : ndarray of str
        Column names seen in ``fit``, if all are strings.

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
    ['run', 'time', 'decimation 1/4 ideal periodic']
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
        padding: str = "periodic",
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
        X : DataFrame or array of shape (n_rows, n_columns)
            Channels, one row per sample.

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
