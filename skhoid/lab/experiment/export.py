"""Files of the estimates for R, SPSS, JASP and others: long with an R script, and wide."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...io import written_whole
from .mixed import BETWEEN, MixedModelResult, mixed_model
from .rows import select

LONGEST = 64  # bytes, in SPSS
RESERVED = {"all", "and", "by", "eq", "ge", "gt", "le", "lt", "ne", "not", "or", "to", "with"}
SPELLED = {
    "°": "deg",
    "%": "percent",
    "Ω": "ohm",
    "µ": "u",
    "μ": "u",
    "α": "alpha",
    "β": "beta",
    "γ": "gamma",
    "δ": "delta",
    "ζ": "zeta",
    "θ": "theta",
    "λ": "lambda",
    "σ": "sigma",
    "τ": "tau",
    "φ": "phi",
    "ω": "omega",
    "²": "2",
    "³": "3",
    "⁻": "-",
    "√": "sqrt",
}


def safe(text: str) -> str:
    """Text in letters, digits and underscores.

    Examples
    --------
    >>> from skhoid.lab.experiment.export import safe
    >>> safe("ζ_nm"), safe("day 2"), safe("Müller")
    ('zeta_nm', 'day_2', 'Muller')
    """
    for sign, word in SPELLED.items():
        text = text.replace(sign, word)
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_")


def unit_suffix(unit: str) -> str:
    """A unit as the end of a name; nothing for none.

    Examples
    --------
    >>> from skhoid.lab.experiment.export import unit_suffix
    >>> unit_suffix("deg/deg"), unit_suffix("rad/s^2"), unit_suffix("-")
    ('_deg_per_deg', '_rad_per_s2', '')
    """
    spelled = unit.replace("^", "").replace("**", "").replace("/", " per ")
    name = safe(re.sub(r"-(?=\d)", "minus", spelled))
    return f"_{name}" if name else ""


def variable_names(wanted: Sequence[tuple[str, str]]) -> list[str]:
    """A name for each pair of a stem and a suffix: distinct in any case, and short enough.

    The suffix stays whole; stems that are too long are cut, and those alike are numbered.
    """
    names: list[str] = []
    taken: set[str] = set()
    for stem, suffix in wanted:
        stem = safe(stem)
        if not stem[:1].isalpha():
            stem = f"v_{stem}"
        suffix = suffix[: LONGEST // 2]
        name, count = stem[: LONGEST - len(suffix)] + suffix, 1
        while name.lower() in taken or name.lower() in RESERVED:
            count += 1
            more = f"_{count}{suffix}"
            name = stem[: LONGEST - len(more)] + more
        taken.add(name.lower())
        names.append(name)
    return names


HEAD = """# Linear mixed models of identified parameters, as skhoid fitted them.
# Run it with: Rscript {script}
# It needs: install.packages(c("lme4", "lmerTest", "pbkrtest", "emmeans"))
# "skhoid:" in comments are its numbers. The script stops if R finds others.
suppressPackageStartupMessages({{library(lme4); library(lmerTest); library(emmeans)}})

file <- sub("^--file=", "", grep("^--file=", commandArgs(FALSE), value = TRUE))
folder <- if (length(file)) dirname(file[1]) else "."
all_rows <- read.csv(file.path(folder, "{csv}"), encoding = "UTF-8",
                     colClasses = c(subject = "character", condition = "character",
                                    run = "character"), na.strings = "")

# TRUE for each number that is the same to 1e-4 of it, or of its standard error.
same <- function(what, r, skhoid, se = 0) {{
  wrong <- !(abs(r - skhoid) <= 1e-4 * pmax(abs(skhoid), se))
  if (any(wrong))
    stop(what, ": R has ", paste(signif(r[wrong], 8), collapse = " "), ", skhoid ",
         paste(signif(skhoid[wrong], 8), collapse = " "))
  cat("ok  ", what, "\\n")
}}
"""

MODEL = """
# ---- {parameter}{unit}{scale}
d <- subset(all_rows, parameter == {name} & used == 1)
d$condition <- factor(d$condition, levels = {levels})
d$subject <- factor(d$subject)
# One value of each person and condition: runs weighted by 1 / (se^2 + tau^2), tau = {tau:.6g}.
d$part <- d$weight * d$value
cells <- aggregate(cbind(value = part, cell_weight = cell_weight * weight) ~ subject + condition,
                   data = d, FUN = sum)
{fit}"""

MIXED = """
# The model: persons and conditions weighted by 1 / (se^2 + tau^2), tau = {tau_cells:.6g}.
tight <- lmerControl(optimizer = "bobyqa", optCtrl = list(rhoend = 1e-10, maxfun = 1e5),
                     check.conv.singular = "ignore", check.conv.grad = "ignore",
                     check.conv.hess = "ignore")
model <- lmer(value ~ {fixed} + (1 | subject), data = cells, weights = cell_weight,
              REML = TRUE, control = tight)
print(summary(model, ddf = "lme4"))
same("REML criterion", REMLcrit(model), {criterion})
same("means", as.numeric(fixef(model)), {means}, {mean_se})
same("standard deviations", c(attr(VarCorr(model)$subject, "stddev"), sigma(model)), {our_sds},
     sigma(model))

# pbkrtest takes no notice of weights: the same model with columns times the root of the weight.
root <- sqrt(cells$cell_weight)
X <- root * model.matrix(~ {fixed}, cells)
colnames(X) <- paste0("x", seq_len(ncol(X)))
scaled <- data.frame(X, y = root * cells$value, root = root, subject = cells$subject)
again <- lmer(reformulate(c("0", colnames(X), "(0 + root | subject)"), "y"), data = scaled,
              REML = TRUE, control = tight)
{tests}"""

TESTS = """
L <- {L}
tests <- contest(again, L, joint = FALSE, ddf = "Kenward-Roger")
# skhoid: {said}
same("{what}", tests$Estimate, {estimate}, {se})
same("standard errors of {what}", tests[["Std. Error"]], {se})
same("df of {what}", tests$df, {df})
"""

OMNIBUS = """
L <- cbind(-1, diag({n} - 1))
omnibus <- contest(again, L, joint = TRUE, ddf = "Kenward-Roger")
# skhoid: F({df1:.0f}, {df2:.2f}) = {F:.4f}, p = {p:.4g}
same("F", omnibus[["F value"]], {F!r})
same("df of F", omnibus[["DenDF"]], {df2!r})
print(omnibus)
"""

PLAIN = """
# One row of each person: no random effect.
model <- lm(value ~ {fixed}, data = cells, weights = cell_weight)
print(summary(model))
same("means", as.numeric(coef(model)), {means}, {mean_se})
"""

READ_MORE = """
# Means and contrasts by emmeans, for further questions. Its degrees of freedom are Satterthwaite's
# here, as those of Kenward and Roger would leave the weights out.
print(emmeans(model, ~ condition, lmer.df = "satterthwaite"))
print(pairs(emmeans(model, ~ condition, lmer.df = "satterthwaite"), adjust = "holm"))
"""


def r_script(results: Sequence[MixedModelResult], csv: str) -> str:
    """The script for some results, whose rows are in a CSV file beside it."""
    text = HEAD.format(script="mixed_models.R", csv=csv)
    return text + "".join(map(_section, results)) + '\ncat("R and skhoid agree.\\n")\n'


def _section(result: MixedModelResult) -> str:
    conditions = [str(name) for name in result.effects["condition"]]
    fixed = "0 + condition" if len(conditions) > 1 else "1"
    mean, mean_se = _means(result)
    common: dict[str, Any] = {"fixed": fixed, "means": _vector(mean), "mean_se": _vector(mean_se)}
    if BETWEEN not in set(result.variances["source"]):
        fit = PLAIN.format(**common)
    else:
        fit = MIXED.format(
            **common,
            tau_cells=result.tau_cells,
            criterion=repr(result.criterion),
            our_sds=_vector(result.variances["sd"]),
            tests=_tests(result, mean, mean_se),
        )
        if len(conditions) > 1:
            fit += READ_MORE
    return MODEL.format(
        parameter=_line(result.parameter),
        unit=f", {_line(result.unit)}" if result.unit else "",
        scale=", as logarithm" if result.transform == "log" else "",
        name=_quoted(result.parameter),
        levels=f"c({', '.join(map(_quoted, conditions))})",
        tau=result.tau,
        fit=fit,
    )


def _means(result: MixedModelResult) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard errors on the scale of the model."""
    mean, se = (result.effects[name].to_numpy(dtype=float) for name in ("mean", "se"))
    return (np.log(mean), se / mean) if result.transform == "log" else (mean, se)


def _tests(result: MixedModelResult, mean: np.ndarray, se: np.ndarray) -> str:
    conditions = list(result.effects["condition"])
    n = len(conditions)
    text = TESTS.format(
        L=f"diag({n})",
        said=", ".join(
            f"{_line(c)} {m:.6g} ({s:.4g})" for c, m, s in zip(conditions, mean, se, strict=True)
        ),
        what="means of conditions",
        estimate=_vector(mean),
        se=_vector(se),
        df=_vector(result.effects["df"]),
    )
    if result.omnibus is None:
        return text
    L = np.zeros((len(result.contrasts), n), dtype=int)
    for k, row in enumerate(result.contrasts.to_dict("records")):
        L[k, conditions.index(row["condition"])] = 1
        L[k, conditions.index(row["against"])] = -1
    told = [
        f"{_line(row['condition'])} - {_line(row['against'])} {row['difference']:.6g} "
        f"({row['se']:.4g}), p = {row['p']:.3g}, {result.adjust} {row['p_adjusted']:.3g}"
        for row in result.contrasts.to_dict("records")
    ]
    text += TESTS.format(
        L=f"matrix(c({', '.join(map(str, L.ravel()))}), ncol = {n}, byrow = TRUE)",
        said="\n#         ".join(told),
        what="contrasts",
        estimate=_vector(result.contrasts["difference"]),
        se=_vector(result.contrasts["se"]),
        df=_vector(result.contrasts["df"]),
    )
    return text + OMNIBUS.format(n=n, **{k: float(v) for k, v in result.omnibus._asdict().items()})


def _vector(values: Any) -> str:
    return f"c({', '.join(repr(float(value)) for value in values)})"


def _line(text: Any) -> str:
    """Text that cannot leave its comment."""
    return " ".join(str(text).split())


def _quoted(text: Any) -> str:
    """A string of R."""
    escaped = str(text).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


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
