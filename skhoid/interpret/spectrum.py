"""Auto-power-spectral densities of recorded channels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import periodogram

from .._sklearn import DT, WINDOW, checked
from ..runs import run_column, run_name
from .lines import Windows, all_bins, read_lines, signal_table


@checked(window=WINDOW, period=DT, dt=DT)
def auto_psd(
    X: Any,
    *,
    forcing: Any = None,
    window: tuple[float, float] | None = None,
    period: float | None = None,
    dt: float | None = None,
    run: Any = None,
) -> pd.DataFrame:
    """Auto-power-spectral density of every channel of every run.

    One-sided, per rad/s: the sum of S over the frequencies, times their spacing, is the mean square
    of the signal. Uses the DFT of the whole window, without a taper; means are kept, at omega = 0.

    Parameters
    ----------
    X : DataFrame, Series or array of shape (n_rows, n_channels) or (n_rows,)
        Channels, one row per sample; runs and time are read from its index.
    forcing : Multisine, array-like of frequencies in rad/s, dict of these or None, default=None
        Marks the excited lines, which must be bins of the window.
    window : (float, float) or None, default=None
        Use only rows with ``window[0] <= time < window[1]``, in seconds. None means whole runs.
    period : float or None, default=None
        Base period in seconds, if ``forcing`` does not have its own.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Returns
    -------
    table : DataFrame with the columns ``run``, ``channel``, ``omega`` (rad/s) and ``psd``
        ``psd`` is in the squared unit of the channel per rad/s. With ``forcing`` there is also a
        column ``excited`` (bool).

    Examples
    --------
    >>> import numpy as np
    >>> from skhoid import auto_psd
    >>> t = 0.01 * np.arange(1000)
    >>> table = auto_psd(np.sin(2 * np.pi * t), forcing=[2 * np.pi], dt=0.01)
    >>> spacing = 2 * np.pi / 10
    >>> round(float(table["psd"].sum() * spacing), 6)
    0.5
    >>> table.loc[table["excited"], "omega"].round(3).tolist()
    [6.283]
    """
    frame = signal_table(X)
    windows = Windows.of(frame, window, dt, run)
    if run is not None:
        keep = np.arange(frame.shape[1]) != run_column(list(frame.columns), run)
        frame = frame.loc[:, keep]
    values, step = windows.numbers(frame), windows.layout.dt
    tables = []
    for number, rows in enumerate(windows.rows):
        label = windows.layout.labels[number]
        omega, density = periodogram(values[rows], fs=2 * np.pi / step, detrend=False, axis=0)
        columns = {
            "run": run_name(label) if isinstance(label, tuple) else label,
            "channel": np.repeat(frame.columns.to_numpy(), omega.size),
            "omega": np.tile(omega, frame.shape[1]),
            "psd": density.T.ravel(),
        }
        if forcing is not None:
            bins = all_bins(read_lines(forcing, period), windows, number)
            excited = np.isin(np.arange(omega.size), np.concatenate(list(bins.values())))
            columns["excited"] = np.tile(excited, frame.shape[1])
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)
