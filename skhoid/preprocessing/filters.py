"""The filters of :class:`skhoid.Decimator`, for inputs and outputs alike, and the way back.

Both directions work stretch by stretch (runs, cut at gaps and at the end of the run-in), so that
nothing leaks from one stretch into another.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy import fft, signal

from ..runs import DecimationMark

METHODS = ("ideal", "downsample", "aggregate")
PADDINGS = ("periodic", "odd")
_ODD_ROWS = 50  # rows of the thinned grid reflected at each end


def lowpass(values: np.ndarray, stretches: np.ndarray, mark: DecimationMark) -> np.ndarray:
    """Filter columns at full rate before thinning by ``mark.factor``; NaN stay where they are."""
    if mark.method == "downsample":
        return values
    result = np.array(values, dtype=float)
    columns = result if result.ndim == 2 else result[:, None]
    smooth = _brick_wall if mark.method == "ideal" else _block_mean
    for a, b in pairwise(stretches):
        part = columns[a:b]
        missing = np.isnan(part)
        if missing.any():
            part = _bridge(part, missing)
        part = smooth(part, mark)
        part[missing] = np.nan
        columns[a:b] = part
    return result


def _bridge(part: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Fill NaN by linear interpolation, so that they do not spread through the filter."""
    part, rows = part.copy(), np.arange(len(part))
    for column in range(part.shape[1]):
        gaps = missing[:, column]
        if gaps.all():
            part[:, column] = 0.0
        elif gaps.any():
            part[gaps, column] = np.interp(rows[gaps], rows[~gaps], part[~gaps, column])
    return part


def _brick_wall(part: np.ndarray, mark: DecimationMark) -> np.ndarray:
    """Ideal noncausal filter: keep the DFT bins below the new Nyquist frequency."""
    n_rows = len(part)
    margin = 0
    if mark.padding == "odd":
        margin = min(n_rows - 1, _ODD_ROWS * mark.factor)
        part = _odd_extension(part, margin)
    spectrum = fft.rfft(part, axis=0)
    bins = np.arange(len(spectrum))
    spectrum[2 * mark.factor * bins >= len(part)] = 0.0
    smooth = fft.irfft(spectrum, n=len(part), axis=0)
    return smooth[margin : margin + n_rows]


def _block_mean(part: np.ndarray, mark: DecimationMark) -> np.ndarray:
    """Piecewise aggregate: the mean of a row and the rows up to the next kept one."""
    n_rows = len(part)
    level = part.mean(axis=0)
    total = np.vstack([np.zeros((1, part.shape[1])), np.cumsum(part - level, axis=0)])
    stop = np.minimum(np.arange(n_rows) + mark.factor, n_rows)
    count = (stop - np.arange(n_rows))[:, None]
    return level + (total[stop] - total[:n_rows]) / count


def _odd_extension(part: np.ndarray, margin: int) -> np.ndarray:
    return np.pad(part, ((margin, margin), (0, 0)), mode="reflect", reflect_type="odd")


@lru_cache(maxsize=16)
def _resampling_filter(up: int) -> np.ndarray:
    """The filter that resample_poly would design anew at every call."""
    return signal.firwin(20 * up + 1, 1 / up, window=("kaiser", 5.0))


def to_full_rate(
    values: np.ndarray,
    kept: np.ndarray,
    stretches: np.ndarray,
    mark: DecimationMark,
    wanted_rows: np.ndarray | None = None,
) -> np.ndarray:
    """Interpolate kept-row values back to every row, band-limited (windowed sinc).

    Rows before the first and after the last kept row of a stretch are extrapolated by odd
    reflection. A block mean belongs to the middle of its block. Stretches without any of
    ``wanted_rows`` (a mask) are left at zero.
    """
    n_rows = int(stretches[-1])
    result = np.zeros(n_rows)
    offset = (mark.factor - 1) / 2 if mark.method == "aggregate" else 0.0
    finer = 1 if offset == int(offset) else 2
    up = mark.factor * finer
    bounds = np.searchsorted(kept, stretches)
    for a, b, i, j in zip(stretches[:-1], stretches[1:], bounds[:-1], bounds[1:], strict=True):
        if i == j or (wanted_rows is not None and not wanted_rows[a:b].any()):
            continue
        part = values[i:j]
        wanted = (np.arange(a, b) - kept[i] - offset) * finer
        if len(part) == 1:
            result[a:b] = part[0]
            continue
        margin = _ODD_ROWS // 2
        padded = np.pad(part, margin, mode="reflect", reflect_type="odd")
        fine = signal.resample_poly(padded, up, 1, window=_resampling_filter(up))
        result[a:b] = fine[(wanted + margin * up).astype(np.int64)]
    return result
