"""Which column of a file is which: guessed from the headers and the first rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ._column_guess import ColumnGuess, Problem, UnclearColumnsError
from ._guessing import guess_of
from .readers import first_table

__all__ = ["ColumnGuess", "Problem", "UnclearColumnsError", "guess_columns"]


def guess_columns(
    paths: Any,
    *,
    roles: Mapping[str, str] | None = None,
    output: str | Mapping[str, str] | None = None,
    time: str | None = None,
    run: str | None = None,
    units: Mapping[str, str] | None = None,
    dt: float | None = None,
    signals: bool = True,
) -> ColumnGuess:
    """Guess which column of a file is which, from the headers and the first 1,000 rows.

    Parameters
    ----------
    paths : path, glob pattern, or list of these
        As in :func:`skhoid.read_runs`; the first file is looked at.
    roles : dict or None, default=None
        Columns that are known, with their roles: ``{"err": "e"}``. They keep their names.
    output, time, run, units, dt
        As in :func:`skhoid.read_runs`; None is guessed.
    signals : bool, default=True
        False takes no other channels than those of `roles`, and the output.

    Returns
    -------
    guess : ColumnGuess
        Its text says in one line which column is which; ``problems`` what is not clear.

    See Also
    --------
    skhoid.read_runs : Reads files, by a guess for what is not named.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skhoid.io.guess import guess_columns
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "s1.csv"
    ...     _ = path.write_text("Time [ms],Tracking error (deg),Stick\\n0,1.5,0\\n10,1.2,.1\\n")
    ...     print(guess_columns(path))
    Columns: time "Time [ms]", error e "Tracking error (deg)", output u "Stick"
    """
    given: dict[str, Any] = {"roles": roles, "output": output, "time": time, "run": run}
    return guess_of(first_table(paths), paths, **given, units=units, dt=dt, signals=signals)
