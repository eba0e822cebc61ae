"""Frequency responses and spectra at excited lines: the method of Fourier coefficients."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.signal import periodogram
from sklearn.utils.validation import check_consistent_length

from .._sklearn import DT, WINDOW, checked
from ..metrics import scored_rows
from ..preprocessing.gate import as_output, as_table, check_numbers
from ..runs import (
    RunLayout,
    check_alignment,
    input_columns,
    output_name,
    read_layout,
    run_column,
    run_name,
)
from .response import FrequencyResponse, find_aligning_delay, unwrap_phase

BIN_TOLERANCE = 0.01  # of a bin; so far off, one percent of a line leaks into its neighbours


def read_lines(forcing: Any) -> dict[str | None, np.ndarray]:
    """Excited frequencies (rad/s) of every forcing function; the only one has no name."""
    parts = forcing if isinstance(forcing, dict) else {None: forcing}
    found = {}
    for name, part in parts.items():
        try:
            omega = np.atleast_1d(np.asarray(getattr(part, "omega", part), dtype=float))
        except (TypeError, ValueError):  # no numbers
            omega = np.zeros(0)
        if omega.ndim == 1 and omega.size and np.all(np.isfinite(omega) & (omega > 0)):
            found[name] = np.sort(omega)
    if not parts or len(found) < len(parts):
        raise ValueError(
            "forcing must be a Multisine, its frequencies in rad/s (positive numbers), or a "
            f"dict of these; got {forcing!r}."
        )
    return found


def measure_off(cycles: np.ndarray) -> np.ndarray:
    """Distance in bins of numbers of periods from whole ones, other than none."""
    return np.where(cycles < 0.5, 1.0, np.abs(cycles - np.round(cycles)))


def collect_bins(
    lines: dict[Any, np.ndarray], windows: Windows, number: int
) -> dict[Any, np.ndarray]:
    """Bins of every forcing function in the window of a run; none is shared."""
    layout, rows = windows.layout, windows.rows[number]
    dt, n_samples = layout.dt, rows.stop - rows.start
    found = {}
    for name, omega in lines.items():
        cycles = omega * n_samples * dt / (2 * np.pi)
        off = measure_off(cycles)
        worst = int(np.argmax(off))
        if off[worst] > BIN_TOLERANCE:
            n_in_run = int(layout.run_starts[number + 1] - layout.run_starts[number])
            raise ValueError(
                f"Every line needs a whole number of periods in the window, but in {n_samples} "
                f"samples ({n_samples * dt:.6g} s) of run {layout.labels[number]!r} the line at "
                f"{omega[worst]:.6g} rad/s completes {cycles[worst]:.4g} periods. "
                + find_fitting_window(omega, n_in_run, dt)
            )
        if omega[-1] * dt >= np.pi:
            raise ValueError(
                f"The line at {omega[-1]:.6g} rad/s is not below the Nyquist frequency of "
                f"{np.pi / dt:.6g} rad/s (dt = {dt:g} s). Are the frequencies in rad/s?"
            )
        found[name] = np.round(cycles).astype(int)
    bins, counts = np.unique(np.concatenate(list(found.values())), return_counts=True)
    if counts.max() > 1:
        twice = 2 * np.pi * bins[np.argmax(counts)] / (n_samples * dt)
        raise ValueError(
            f"The line at {twice:.6g} rad/s is given twice: responses to two functions at the "
            "same line cannot be separated."
        )
    return found


def find_fitting_window(omega: np.ndarray, n_in_run: int, dt: float) -> str:
    """What to do where a window does not hold whole periods."""
    lengths = np.arange(n_in_run, 0, -1)
    off = measure_off(np.outer(lengths * dt, omega) / (2 * np.pi)).max(axis=1)
    fitting = np.flatnonzero(off <= BIN_TOLERANCE)
    if fitting.size == 0:
        return (
            f"No window fits in the run's {n_in_run * dt:.6g} s: are the frequencies in rad/s, "
            "and is the run at least one base period long?"
        )
    # Lengths a sample or two off the right one are within the tolerance too.
    beside = fitting[fitting - np.arange(fitting.size) == fitting[0]]
    best = lengths[beside[np.argmin(off[beside])]]
    return (
        f"The longest window in the run that fits lasts {best * dt:.6g} s ({best} "
        f"samples): pass window=(start, start + {best * dt:.6g})."
    )


def read_signals(X: Any) -> pd.DataFrame:
    X = X if isinstance(X, pd.Series) else as_table(X)
    if isinstance(X, pd.DataFrame):
        return X
    if isinstance(X, pd.Series):
        return X.to_frame("signal" if X.name is None else X.name)
    values = np.asarray(X)
    if not values.size or values.ndim > 2:
        raise ValueError(
            "X must be a table of shape (n_rows, n_channels), with at least one of each; got the "
            f"shape {values.shape}."
        )
    return pd.DataFrame(values[:, None] if values.ndim == 1 else values)


@dataclass(frozen=True)
class Windows:
    """Gapless windows of runs: rows of a table, one window per run."""

    layout: RunLayout
    rows: list[slice]

    @classmethod
    def of(cls, X: pd.DataFrame, window: Any, dt: float | None, run: Any) -> Windows:
        layout = read_layout(X, dt=dt, run=run)
        if layout.mark is not None:
            raise ValueError(
                "X comes from a Decimator, which filtered X but not y. Pass the recording itself: "
                "Fourier coefficients need no decimation."
            )
        inside = scored_rows(layout, None, window)
        rows = []
        for label, a, b in zip(
            layout.labels, layout.run_starts[:-1], layout.run_starts[1:], strict=True
        ):
            kept = a + np.flatnonzero(inside[a:b])
            if kept.size == 0:
                raise ValueError(
                    f"Run {label!r}, from {layout.time[a]:.6g} to {layout.time[b - 1]:.6g} s, has "
                    f"no row in the window {window} s."
                )
            first, last = int(kept[0]), int(kept[-1])
            gaps = layout.starts[(layout.starts > first) & (layout.starts <= last)]
            if gaps.size or kept.size < last - first + 1:
                row = int(gaps[0] if gaps.size else kept[np.argmax(np.diff(kept) > 1) + 1])
                raise ValueError(
                    f"A gap ends at {layout.where(row)}; a Fourier transform needs a window "
                    "without gaps. Choose one before or after it with window=(start, end)."
                )
            rows.append(slice(first, last + 1))
        return cls(layout, rows)

    def numbers(self, table: pd.DataFrame) -> np.ndarray:
        """Values of a table, finite inside the windows."""
        check_numbers(table, "X")
        values = table.to_numpy(dtype=float)
        for rows in self.rows:
            bad = np.argwhere(~np.isfinite(values[rows]))
            if bad.size:
                row, column = bad[0]
                raise ValueError(
                    f"{table.columns[column]!r} is {values[rows][row, column]} in "
                    f"{self.layout.where(rows.start + int(row))}; a Fourier transform needs every "
                    "sample in its window. Leave the run out, or choose another window."
                )
        return values


N_NEIGHBOURS = 6  # bins without excitation, nearest to a line, from which the remnant is read
DOF = 2 * N_NEIGHBOURS  # of the remnant: real and imaginary parts
ABSENT = 1e-6  # of the strongest bin of a forcing function; weaker lines are rounding


@checked(y=["array-like"], window=WINDOW, dt=DT)
def fourier_coefficients(
    X: Any,
    y: Any,
    *,
    forcing: Any,
    inputs: Any = None,
    window: tuple[float, float] | None = None,
    dt: float | None = None,
    run: Any = None,
) -> Any:
    """Estimate frequency responses at the lines of forcing functions, run by run.

    With one input H(j omega_t) = U(j omega_t) / E(j omega_t) at every excited line (Eq. 5.14).
    Several inputs need one forcing function each, with separate lines; U = H_1 E_1 + H_2 E_2 ... is
    then solved at every line.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels, one row per sample; runs and time are read from its index.
    y : Series or array of shape (n_rows,)
        Output u.
    forcing : Multisine, array-like of frequencies in rad/s, or dict of these
        All excited lines (others count as remnant): an object with ``omega``, or
        frequencies; several functions as a dict. With several inputs, its keys are the columns of X
        that hold the signals.
    inputs : list of column names or positions, or None, default=None
        Inputs of the operator. None means the column named ``e`` if there is one, else all.
    window : (float, float) or None, default=None
        Use only rows with ``window[0] <= time < window[1]``, in seconds, a whole number of periods
        of every line. None means whole runs.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Returns
    -------
    response : FrequencyResponse, or dict of them by input if there are several
        At the lines of all forcing functions, of shape (n_runs, n_lines). With several inputs
        lines outside the range of another forcing function are NaN.

    Raises
    ------
    ValueError
        If a window does not hold whole periods, forcing functions share a line, or inputs
        outnumber forcing functions; if a window holds a gap or NaN.

    Notes
    -----
    The remnant N = U - H E is estimated from the six nearest bins without excitation, with H of the
    line, and gives the covariance of real and imaginary parts, ``mean|N|^2 / (2 |E|^2)`` each. The
    coherence of a run, with one input, is ``(1 - mean|E|^2 / |E(line)|^2) (1 - mean|U|^2 /
    |U(line)|^2)``, the means over the same bins and each factor at least 0.

    With several inputs, ratios of signals to a forcing function, which are smooth in frequency, are
    interpolated to the lines of the others: cubic splines of log magnitude and phase in log omega.

    References
    ----------
    Van Grootheest, thesis, Eqs. 5.13-5.14. Van Paassen and Mulder (1998), Identification of human
    operator control behaviour in multiple-loop tracking tasks.

    Examples
    --------
    >>> import numpy as np
    >>> from skhoid import fourier_coefficients
    >>> omega = 2 * np.pi * np.array([1, 3, 7])  # rad/s; all periods fit in 1 s
    >>> t = 0.01 * np.arange(200)
    >>> e = np.sin(np.outer(t, omega)).sum(axis=1)
    >>> u = 2 * np.roll(e, 10)  # gain 2, delay 0.1 s
    >>> response = fourier_coefficients(e[:, None], u, forcing=omega, dt=0.01)
    >>> response.magnitude.round(6), response.phase.round(6)
    (array([[2., 2., 2.]]), array([[ -36., -108., -252.]]))
    """
    frame = read_signals(X)
    check_consistent_length(X, y)
    check_alignment(X, y)
    names = list(frame.columns)
    windows = Windows.of(frame, window, dt, run)
    label = windows.layout.run_column if run is None else run
    positions = input_columns(names, len(names), inputs, label, None)
    lines = read_lines(forcing)
    _check_numbers([names[p] for p in positions], lines)
    several = len(positions) > 1
    columns = positions + [_find_column(names, name) for name in lines if several]
    table = frame.iloc[:, columns].copy()
    table.insert(len(positions), "", as_output(y), allow_duplicates=True)
    output = output_name(y)
    table.columns = [*(names[p] for p in positions), output, *lines][: table.shape[1]]
    spectra = _Spectra(windows, windows.numbers(table), lines)
    of_inputs = [str(names[p]) for p in positions]
    shared: dict[str, Any] = {"omega": spectra.omega, "runs": spectra.layout.labels, "dof": DOF}
    shared["output"] = output
    if several:
        return _estimate_several(spectra, of_inputs, shared)
    response, covariance = spectra.ratio()
    return FrequencyResponse(
        response=response,
        input=of_inputs[0],
        covariance=covariance,
        coherence=spectra.coherence(),
        coefficients=(spectra.at_lines[:, 0], spectra.at_lines[:, 1]),
        **shared,
    )


def _check_numbers(inputs: list[Any], lines: dict[Any, np.ndarray]) -> None:
    """Refuse more inputs than forcing functions, and lines too few to interpolate between."""
    if len(inputs) > len(lines):
        raise ValueError(
            f"{len(inputs)} responses, to the inputs {inputs}, need as many forcing functions, "
            f"but there {'is' if len(lines) == 1 else 'are'} {len(lines)}. Give fewer "
            "inputs=[...], or add another forcing function with separate lines."
        )
    short = [name for name, omega in lines.items() if omega.size < 2]
    if len(inputs) > 1 and short:
        raise ValueError(
            f"The forcing function {short[0]!r} has only one line. Signals are interpolated "
            "between the lines of each function, so it needs two or more."
        )


def _estimate_several(
    spectra: _Spectra, names: list[str], shared: dict[str, Any]
) -> dict[str, FrequencyResponse]:
    """Responses from several inputs, with a warning of lines where there are none."""
    spectra.check_excitation(len(names) + 1)
    solved, variance = spectra.solve(len(names))
    lost = np.isnan(solved).any(axis=(0, 1))
    if lost.any():
        warnings.warn(
            f"{int(lost.sum())} of {lost.size} lines lie outside the range of another forcing "
            f"function and are NaN: {spectra.omega[lost].round(3).tolist()} rad/s.",
            UserWarning,
            stacklevel=3,
        )
    return {
        name: FrequencyResponse(
            response=solved[:, i],
            input=name,
            covariance=variance[:, i, :, None, None] / 2 * np.eye(2),
            **shared,
        )
        for i, name in enumerate(names)
    }


def _find_column(names: list[Any], name: Any) -> int:
    """Column that holds the signal of a forcing function."""
    if name not in names:
        raise ValueError(
            f"The signal of the forcing function {name!r} is needed to tell several inputs apart, "
            f"but X has no column of that name; its columns are {names}. Use the columns of X as "
            "keys of forcing."
        )
    return names.index(name)


class _Spectra:
    """Fourier coefficients of some channels at the lines of forcing functions, run by run.

    Channels are the inputs, the output, and then the forcing functions if they are needed.
    """

    def __init__(self, windows: Windows, values: np.ndarray, lines: dict[Any, np.ndarray]) -> None:
        self.layout, self.lines, dt = windows.layout, lines, windows.layout.dt
        at_lines, beside, strongest = [], [], []
        for number, rows in enumerate(windows.rows):
            n_samples = rows.stop - rows.start
            transform = np.fft.rfft(values[rows], axis=0).T * (2 / n_samples)
            own = collect_bins(lines, windows, number)
            bins = np.concatenate(list(own.values()))
            order = np.argsort(bins)
            strongest.append(np.abs(transform).max(axis=1))
            at_lines.append(transform[:, bins[order]])
            beside.append(transform[:, _find_neighbours(bins[order], (n_samples - 1) // 2)])
        function = np.concatenate([np.full(own[name].size, i) for i, name in enumerate(own)])
        self.function = function[order]
        self.omega = 2 * np.pi * bins[order] / (n_samples * dt)
        self.strongest = np.array(strongest)  # (n_runs, n_channels)
        self.at_lines = np.array(at_lines)  # (n_runs, n_channels, n_lines)
        self.beside = np.array(beside)  # (n_runs, n_channels, n_lines, n_neighbours)

    def coherence(self) -> np.ndarray:
        """Shares of power explained, of the only input times the output."""
        remnant = np.mean(np.abs(self.beside[:, :2]) ** 2, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 1 - remnant / np.abs(self.at_lines[:, :2]) ** 2
        return np.maximum(share, 0.0).prod(axis=1)

    def ratio(self) -> tuple[np.ndarray, np.ndarray]:
        """Response from the only input, and the covariance of its real and imaginary parts."""
        with np.errstate(divide="ignore", invalid="ignore"):
            response = self.at_lines[:, 1] / self.at_lines[:, 0]
            remnant = self.beside[:, 1] - response[..., None] * self.beside[:, 0]
            variance = np.mean(np.abs(remnant) ** 2, axis=-1) / np.abs(self.at_lines[:, 0]) ** 2
        return response, variance[..., None, None] / 2 * np.eye(2)

    def check_excitation(self, first: int) -> None:
        """Refuse a forcing function, in the channels from ``first`` on, that lacks a line."""
        for i, (name, omega) in enumerate(self.lines.items()):
            own = np.abs(self.at_lines[:, first + i, self.function == i])
            absent = np.argwhere(own <= ABSENT * self.strongest[:, first + i, None])
            if absent.size:
                run, line = absent[0]
                raise ValueError(
                    f"The column of the forcing function {name!r} has no power at its line "
                    f"{omega[line]:.6g} rad/s in run {self.layout.labels[run]!r}. Is it "
                    "the right column, and are these its frequencies?"
                )

    def solve(self, n_inputs: int) -> tuple[np.ndarray, np.ndarray]:
        """Responses from several inputs, (n_runs, n_inputs, n_lines), and their variances.

        Each forcing function F gives an equation U/F = H_1 E_1/F + H_2 E_2/F + N/F at every line,
        interpolated between its own. The remnant N is estimated next to the lines and propagated.
        """
        n_runs, n_functions = len(self.at_lines), self.function.max() + 1
        equations = np.empty((n_runs, self.omega.size, n_functions, n_inputs + 1), dtype=complex)
        for i in range(n_functions):
            own = self.function == i
            signals = self.at_lines[:, : n_inputs + 1, own]
            ratios = signals / self._forcing(i, n_inputs)[:, None]
            filled = _interpolate(self.omega[own], ratios, self.omega)
            equations[:, :, i] = np.moveaxis(filled, 1, 2)
        solved = np.full((n_runs, self.omega.size, n_inputs), np.nan, dtype=complex)
        known = np.isfinite(equations).all(axis=(2, 3))
        inverse = np.full((n_runs, self.omega.size, n_inputs, n_functions), np.nan, dtype=complex)
        inverse[known] = np.linalg.pinv(equations[known][..., :-1])
        solved[known] = (inverse[known] @ equations[known][..., -1:])[..., 0]
        responses = np.moveaxis(solved, 2, 1)
        remnant = self.beside[:, n_inputs] - np.einsum(
            "rik,rikn->rkn", responses, self.beside[:, :n_inputs]
        )
        power = np.mean(np.abs(remnant) ** 2, axis=-1)
        noise = np.empty((n_runs, self.omega.size, n_functions))
        for i in range(n_functions):
            own = self.function == i
            share = np.log(power[:, own] / np.abs(self._forcing(i, n_inputs)) ** 2)
            for run, row in enumerate(share):
                some = np.isfinite(row)
                at = np.log(self.omega)
                noise[run, :, i] = np.exp(np.interp(at, at[own][some], row[some]))
        variance = np.einsum("rkif,rkf->rik", np.abs(inverse) ** 2, noise)
        return responses, variance

    def _forcing(self, i: int, n_inputs: int) -> np.ndarray:
        """Fourier coefficients of a forcing function at its own lines, (n_runs, n_own)."""
        return self.at_lines[:, n_inputs + 1 + i, self.function == i]


def _find_neighbours(bins: np.ndarray, last: int) -> np.ndarray:
    """The nearest bins without excitation of each line, of shape (n_lines, N_NEIGHBOURS)."""
    free = np.setdiff1d(np.arange(1, last + 1), bins)
    if free.size < N_NEIGHBOURS:
        raise ValueError(
            f"The window has {free.size} bins without excitation; {N_NEIGHBOURS} are needed to "
            "separate remnant from signal. Use a longer window."
        )
    order = np.argsort(np.abs(free - bins[:, None]), axis=1, kind="stable")
    return free[order[:, :N_NEIGHBOURS]]


def _interpolate(omega: np.ndarray, ratios: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Closed-loop responses (..., n_lines) at other frequencies; NaN outside their range."""
    flat = ratios.reshape(-1, omega.size)
    result = np.full((len(flat), wanted.size), np.nan, dtype=complex)
    inside = (wanted >= omega[0] * (1 - 1e-9)) & (wanted <= omega[-1] * (1 + 1e-9))
    at = wanted[inside]
    for row, values in zip(result, flat, strict=True):
        delay = find_aligning_delay(omega, values)
        phase = unwrap_phase(omega, values, delay) + omega * delay
        curve = CubicSpline(np.log(omega), np.log(np.abs(values)) + 1j * phase)
        row[inside] = np.exp(curve(np.log(at)) - 1j * at * delay)
    result[:, np.searchsorted(wanted, omega * (1 - 1e-9))] = flat
    return result.reshape(*ratios.shape[:-1], wanted.size)


@checked(dt=DT)
def auto_psd(
    X: Any,
    *,
    forcing: Any = None,
    dt: float | None = None,
    run: Any = None,
) -> pd.DataFrame:
    """Auto-power-spectral density of every channel of every run.

    One-sided, per rad/s: the sum of S over the frequencies, times their spacing, is the mean square
    of the signal. Uses the DFT of the whole run, without a taper; means are kept, at omega = 0.

    Parameters
    ----------
    X : DataFrame, Series or array of shape (n_rows, n_channels) or (n_rows,)
        Channels, one row per sample; runs and time are read from its index.
    forcing : Multisine, array-like of frequencies in rad/s, dict of these or None, default=None
        Marks the excited lines, of which a run must hold whole periods.
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
    frame = read_signals(X)
    windows = Windows.of(frame, None, dt, run)
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
            bins = collect_bins(read_lines(forcing), windows, number)
            excited = np.isin(np.arange(omega.size), np.concatenate(list(bins.values())))
            columns["excited"] = np.tile(excited, frame.shape[1])
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)
