"""Files of the estimates for R, SPSS, JASP and others: long with an R script, and wide."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ....io.whole import written_whole
from ._names import unit_suffix, variable_names
from .mixed import mixed_model
from .r_script import r_script
from .result import MixedModelResult
from .rows import select

LONG = "parameters_long.csv"
SCRIPT = "mixed_models.R"
COLUMNS = [
    "parameter",
    "unit",
    "subject",
    "condition",
    "run",
    "estimate",
    "se",
    "value",
    "value_se",
    "weight",
    "cell_weight",
    "used",
    "left_out",
    "outlying",
    "failure",
]


def write_long(
    source: pd.DataFrame | MixedModelResult | Sequence[MixedModelResult],
    folder: str | Path,
    *,
    parameters: Sequence[str] | None = None,
    overwrite: bool = False,
    **options: Any,
) -> tuple[Path, Path]:
    """Write all rows to a CSV file, and an R script that reproduces the mixed models.

    Parameters
    ----------
    source : DataFrame, MixedModelResult or sequence of MixedModelResult
        A tidy table of parameters, for each of which the model is fitted; or results of
        :func:`mixed_model`.
    folder : str or Path
        Folder of the two files; it is made if need be.
    parameters : sequence of str or None, default=None
        Which parameters of a table; None means all.
    overwrite : bool, default=False
        Whether files that are there are replaced.
    **options : dict
        Of :func:`mixed_model`, for a table.

    Returns
    -------
    csv, script : Path
        ``parameters_long.csv`` and ``mixed_models.R``.

    Raises
    ------
    FileExistsError
        If one of the files is there, and ``overwrite`` is False. Nothing is written then.
    ValueError
        If a model of the table cannot be fitted.

    See Also
    --------
    write_wide : A row for each person, for SPSS and JASP.

    Notes
    -----
    The CSV file has dots for decimals, UTF-8, and a column ``unit``, as parameters differ in it.
    ``value`` is the estimate on the scale of the model, ``weight`` the share of the run in its
    person and condition, ``cell_weight`` the weight of these, with the mean 1; ``used`` is 1 or 0,
    and ``left_out`` says why. The script needs lme4, lmerTest, pbkrtest and emmeans. It stops if a
    number of R differs from the one written by more than 1e-4 of it (or of its standard error,
    where that is larger).

    pbkrtest takes no notice of weights. The script therefore fits the same model twice: with
    weights, and with all columns multiplied by the square roots of the weights, for which the
    method of Kenward and Roger is right.

    Examples
    --------
    >>> import tempfile
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import write_long
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabbccdd"),
    ...         "condition": ["C1", "C2"] * 4,
    ...         "run": 1,
    ...         "unit": "s",
    ...         "parameter": "tau_e",
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...         "se": 0.01,
    ...         "outlying": "",
    ...         "failure": "",
    ...     }
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_long(table, folder)]
    ['parameters_long.csv', 'mixed_models.R']
    """
    if isinstance(source, pd.DataFrame):
        results = [mixed_model(source, name, **options) for name in _wanted(source, parameters)]
    else:
        results = [source] if isinstance(source, MixedModelResult) else list(source)
        if options or parameters is not None:
            raise ValueError(
                f"{', '.join([*options, *['parameters'] * (parameters is not None)])}: of use with "
                "a table only; results are written as they are."
            )
    if not results:
        raise ValueError("There is no result to write.")
    names = [result.parameter for result in results]
    if len(set(names)) < len(names):
        raise ValueError(f"There are several results of one parameter: {', '.join(names)}.")
    folder = Path(folder)
    csv, script = folder / LONG, folder / SCRIPT
    _refuse_existing([csv, script], overwrite)
    rows = pd.concat([result.data for result in results], ignore_index=True)
    rows["parameter"] = [
        result.parameter for result in results for _ in range(len(result.data))
    ]  # fits that failed have none of their own
    rows["used"] = (rows["left_out"] == "").astype(int)
    text = r_script(results, LONG)
    folder.mkdir(parents=True, exist_ok=True)
    with written_whole(csv) as first, written_whole(script) as second:
        rows[COLUMNS].to_csv(first, index=False, encoding="utf-8", float_format="%.17g")
        second.write_text(text, encoding="utf-8")
    return csv, script


def write_wide(
    table: pd.DataFrame,
    path: str | Path,
    *,
    parameters: Sequence[str] | None = None,
    outlying: str = "keep",
    overwrite: bool = False,
) -> Path:
    """Write a row for each person, with a column for each parameter and condition.

    Parameters
    ----------
    table : DataFrame
        Tidy table of parameters.
    path : str or Path
        CSV file to write.
    parameters : sequence of str or None, default=None
        Which parameters; None means all.
    outlying : {"keep", "leave_out"}, default="keep"
        What becomes of rows that the table calls outlying.
    overwrite : bool, default=False
        Whether a file that is there is replaced.

    Returns
    -------
    path : Path
        The file.

    Raises
    ------
    FileExistsError
        If the file is there, and ``overwrite`` is False.

    See Also
    --------
    write_long : All rows, with weights and an R script.

    Notes
    -----
    Values are plain means of the runs; empty where there are none. Names are such as
    ``K_e_C1_deg_per_deg``: parameter, condition and unit, in letters, digits and underscores, at
    most 64 bytes, which SPSS and JASP take as they are; brackets and slashes they do not. Decimals
    are dots, and the text is UTF-8 (with a mark, by which SPSS and Excel know it).

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import write_wide
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabb"),
    ...         "condition": ["C1", "C2"] * 2,
    ...         "run": 1,
    ...         "unit": "s",
    ...         "parameter": "tau_e",
    ...         "estimate": [0.21, 0.24, 0.25, 0.29],
    ...         "se": 0.01,
    ...         "outlying": "",
    ...         "failure": "",
    ...     }
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_wide(table, Path(folder) / "wide.csv")
    ...     print(path.read_text(encoding="utf-8-sig"))
    subject,tau_e_C1_s,tau_e_C2_s
    a,0.21,0.24
    b,0.25,0.29
    """
    path = Path(path)
    columns: dict[tuple[str, str], pd.Series] = {}
    subjects: dict[Any, None] = {}
    for name in _wanted(table, parameters):
        rows = select(table, name, weighted=False, outlying=outlying)
        subjects |= dict.fromkeys(table["subject"])
        means = rows.runs.groupby(["condition", "subject"], sort=False)["estimate"].mean()
        for condition in rows.conditions:
            label = "" if condition == "all" else f"_{condition}"
            columns[f"{name}{label}", unit_suffix(rows.unit)] = means[condition]
    names = variable_names([("subject", ""), *columns])
    wide = pd.DataFrame({"subject": list(subjects)})
    for name, means in zip(names[1:], columns.values(), strict=True):
        wide[name] = wide["subject"].map(means)
    _refuse_existing([path], overwrite)
    with written_whole(path) as aside:
        wide.to_csv(aside, index=False, encoding="utf-8-sig", float_format="%.12g")
    return path


def _wanted(table: pd.DataFrame, parameters: Sequence[str] | None) -> list[str]:
    if parameters is not None:
        return [parameters] if isinstance(parameters, str) else list(parameters)
    found = [name for name in dict.fromkeys(table["parameter"].fillna("")) if name]
    if not found:
        raise ValueError("The table has no parameter: all fits failed, or it is empty.")
    return found


def _refuse_existing(paths: Sequence[Path], overwrite: bool) -> None:
    there = [str(path) for path in paths if path.exists()]
    if there and not overwrite:
        raise FileExistsError(
            f"{' and '.join(there)} would be replaced: name another place, or use overwrite=True."
        )
