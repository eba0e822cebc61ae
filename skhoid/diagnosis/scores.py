"""Performance scores of an experiment, by window (Table VI)."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd

from .._sklearn import DT, ROLES, checked
from ..exceptions import RunIndexError, ShortRunError, UsageError
from ..recordings.recording import NamedSignals
from ..runs import RUN, TIME, WHOLE, RunLayout, read_layout
from ..runs.roles import EXACT, with_error, with_target

REGION = 30.72  # s, initial and final region (Section VI-B)
TRANSITION = 20.48  # s
NAMED = ("T_m", "ini", "tran", "fin")

Window = str | tuple[float, float]


@checked(
    windows=[Mapping, tuple, list],
    change=[Real, None],
    roles=ROLES,
    dt=DT,
)
def performance_scores(
    X: Any,
    y: Any,
    windows: Any = ("T_m", "ini", "tran", "fin"),
    *,
    change: float | None = None,
    roles: dict | None = None,
    dt: float | None = None,
    run: Any = None,
) -> pd.DataFrame:
    """Score tracking performance and control activity of each run, in windows of time.

    As in Table VI of the thesis: the root mean square of the error, including its mean; the
    tracking score var(e) / var(f_t); the control activity var(u). Variances are about the mean of
    the window. Missing values are left out of the scores that need them, and counted.

    Parameters
    ----------
    X : DataFrame or array of shape (n_rows, n_channels)
        Channels, with the roles e, x and f_t. Without e it is f_t - x, without f_t it is e + x.
    y : Series, array of shape (n_rows,) or None
        The operator's output u. An output of the role x, such as a cursor, serves as x too.
    windows : sequence or dict, default=("T_m", "ini", "tran", "fin")
        ``"T_m"`` is the whole run, ``"ini"`` its first and ``"fin"`` its last 30.72 s, ``"tran"``
        the 20.48 s around ``change``. Your own windows are (start, stop), in seconds of the time
        index and excluding the row at stop; a dict names them.
    change : float or None, default=None
        Time around which ``"tran"`` is centred, in seconds of the time index. None means the middle
        of the run.
    roles : dict or None, default=None
        ``{column: role}`` for columns whose names are not their roles.
    dt : float or None, default=None
        Sampling time in seconds of data without a time index (None: 1).
    run : column name or position, or None, default=None
        Run column of data without a run index.

    Returns
    -------
    scores : DataFrame
        One row for each run and window. Columns: the levels of the row index (``subject``,
        ``condition``, ``run``, if present), ``window``, its ``start`` and ``stop`` in the run (s),
        ``rms_e``, ``tracking_score``, ``control_activity``, ``n_samples``, and ``n_missing``, the
        samples of them in which a signal is NaN. A score without its signal is NaN: without f_t, or
        e and x to compute it from, there is no tracking score. ``scores.attrs["units"]`` has the
        units that X and y have.

    Raises
    ------
    ShortRunError
        If a run is shorter than a named window, or has no row in a window.
    ValueError
        If there is neither an error nor an output, or a window is not valid.

    References
    ----------
    Van Grootheest, thesis, Section VI-B and Table VI.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid import make_tracking_runs
    >>> from skhoid.diagnosis.scores import performance_scores
    >>> runs = {
    ...     subject: make_tracking_runs(
    ...         "C4", n_runs=5, remnant_intensity=P_n, channels=["e", "f_t"], random_state=0
    ...     )
    ...     for subject, P_n in {"S1": 0.1, "S2": 0.2}.items()
    ... }
    >>> X = pd.concat({subject: X for subject, (X, _) in runs.items()}, names=["subject"])
    >>> y = pd.concat({subject: y for subject, (_, y) in runs.items()}, names=["subject"])
    >>> scores = performance_scores(X, y)
    >>> scores.shape
    (40, 10)

    The average over the runs of each subject:

    >>> table = scores.groupby(["subject", "window"], sort=False)["tracking_score"].mean().unstack()
    >>> table.round(2)
    window    T_m   ini  tran   fin
    subject
    S1       0.23  0.20  0.31  0.22
    S2       0.30  0.21  0.41  0.34
    """
    layout = read_layout(X, dt=dt, run=run)
    if layout.time.size == 0:
        raise RunIndexError("X has no rows: there is nothing to score.")
    if layout.mark is not None:
        raise RunIndexError(
            "X comes from a Decimator, which has filtered it and not y. Score the recording itself."
        )
    signals = NamedSignals(X, y, roles=roles, run=layout.run_column if run is None else run)
    e, f_t, u, units = _scored(signals)
    names = _level_names(X, layout, run)
    wanted = _wanted(windows)
    rows = []
    for number, label in enumerate(layout.labels):
        levels = dict(zip(names, label if isinstance(label, tuple) else (label,), strict=True))
        a, b = layout.run_starts[number], layout.run_starts[number + 1]
        inside = slice(a, b)
        for name, window in wanted.items():
            kept, start, stop = _rows_inside(layout, inside, label, window, change)
            part = [None if s is None else s[kept] for s in (e, f_t, u)]
            scores = _scores(*part)
            rows.append({**levels, "window": name, "start": start, "stop": stop, **scores})
    table = pd.DataFrame(rows)
    table.attrs["units"] = {name: unit for name, unit in units.items() if unit is not None}
    return table


def _scored(signals: NamedSignals) -> tuple[Any, Any, Any, dict[str, str | None]]:
    """Error, target and output, as far as they are there or can be made, and units of scores."""
    found = {role: signals.of_role(role) for role in EXACT}
    known = {role: values for role, (values, _) in found.items() if values is not None}
    known = with_target(with_error(known))
    e, f_t = known.get("e"), known.get("f_t")
    of_e, of_x, of_f = (found[role][1] for role in EXACT)
    if found["e"][0] is None and e is not None:
        of_e = of_f or of_x
    if e is None and signals.output is None:
        raise UsageError(
            "There is nothing to score: X has no error (a column of the role 'e', or 'f_t' and "
            f"'x'), and y is None. The columns are {signals.channels}.",
            hint="Give roles={column: 'e'}.",
            options=["role"],
        )
    of_u = signals.units.get(signals.output_name)
    if of_u is not None:
        of_u = f"{of_u}^2" if of_u.isalpha() else f"({of_u})^2"
    units = {
        "start": "s",
        "stop": "s",
        "rms_e": of_e,
        "tracking_score": "1",
        "control_activity": of_u,
    }
    return e, f_t, signals.output, units


def _level_names(X: Any, layout: RunLayout, run: Any) -> list[Any]:
    """Names of the index levels that the labels of the runs are made of, or of the run column."""
    index = getattr(X, "index", None)
    if not isinstance(index, pd.MultiIndex):
        return [run if isinstance(run, str) else RUN]
    # Marks of a RunInTrimmer are the last levels.
    width = len(layout.labels[0]) if isinstance(layout.labels[0], tuple) else 1
    return [name for name in index.names if name != TIME][:width]


def _wanted(windows: Any) -> dict[str, Window]:
    """Windows by name."""
    pairs = windows.items() if isinstance(windows, Mapping) else ((None, w) for w in windows)
    wanted: dict[str, Window] = {}
    for name, window in pairs:
        if isinstance(window, str) and window in NAMED:
            wanted[name or window] = window
            continue
        try:
            start, stop = map(float, window)
        except (TypeError, ValueError):
            start = stop = np.nan
        if not start < stop:
            raise ValueError(
                f"A window must be one of {NAMED} or (start, stop) in seconds, and must begin "
                f"before it ends; got {window!r}."
            )
        wanted[name or f"{start:g}-{stop:g} s"] = (start, stop)
    if not wanted:
        raise ValueError("windows must name one window at least.")
    return wanted


def _rows_inside(
    layout: RunLayout, run: slice, label: Any, window: Window, change: float | None
) -> tuple[np.ndarray, float, float]:
    """Rows of a run inside a window, and where it begins and ends."""
    rows = np.arange(run.start, run.stop)
    if layout.trimmed is not None:
        rows = rows[~layout.trimmed[run]]
    time = layout.time[rows]
    first, last = float(time[0]), float(time[-1]) + layout.dt
    slack = WHOLE * max(1.0, last - first)
    if isinstance(window, str):
        middle = (first + last) / 2 if change is None else float(change)
        start, stop = {
            "T_m": (first, last),
            "ini": (first, first + REGION),
            "tran": (middle - TRANSITION / 2, middle + TRANSITION / 2),
            "fin": (last - REGION, last),
        }[window]
        if start < first - slack or stop > last + slack:
            raise ShortRunError(
                f"Run {label!r} lasts from {first:.6g} to {last:.6g} s, and the window {window!r} "
                f"from {start:.6g} to {stop:.6g} s. Give windows that fit: 'T_m', (start, stop) "
                "or {name: (start, stop)}" + (", or another change=." if window == "tran" else ".")
            )
    else:
        start, stop = max(first, float(window[0])), min(last, float(window[1]))
    kept = rows[(time >= start - slack) & (time < stop - slack)]
    if kept.size == 0:
        raise ShortRunError(
            f"Run {label!r} lasts from {first:.6g} to {last:.6g} s and has no row in the window "
            f"{window!r}."
        )
    return kept, start, stop


def _scores(e: Any, f_t: Any, u: Any) -> dict[str, float]:
    known = [~np.isnan(signal) for signal in (e, f_t, u) if signal is not None]
    score = np.nan
    if e is not None and f_t is not None:
        both = ~np.isnan(e) & ~np.isnan(f_t)
        of_target = _variance(f_t[both])
        score = _variance(e[both]) / of_target if of_target > 0 else np.nan
    return {
        "rms_e": np.nan if e is None else float(np.sqrt(_mean(e[~np.isnan(e)] ** 2))),
        "tracking_score": score,
        "control_activity": np.nan if u is None else _variance(u[~np.isnan(u)]),
        "n_samples": known[0].size,
        "n_missing": int((~np.logical_and.reduce(known)).sum()),
    }


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else np.nan


def _variance(values: np.ndarray) -> float:
    return float(values.var()) if values.size else np.nan
