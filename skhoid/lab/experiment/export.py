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
from .groups import ALL
from .mixed import BETWEEN, MixedModelResult
from .rows import select

LONGEST = 64  # bytes, in SPSS
RESERVED = {"all", "and", "by", "eq", "ge", "gt", "le", "lt", "ne", "not", "or", "to", "with"}
SIGNS = {"°": "deg", "%": "percent", "Ω": "ohm", "µ": "u", "²": "2", "³": "3", "√": "sqrt"}


def _spell(text: str) -> str:
    """Text in letters, digits and underscores; Greek letters by their names."""
    spelled = ""
    for sign in text:
        name = unicodedata.name(sign, "")
        greek = name.startswith("GREEK") and " LETTER " in name
        spelled += SIGNS.get(sign) or (name.split()[3].lower() if greek else sign)
    plain = unicodedata.normalize("NFKD", spelled).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_")


def _unit_suffix(unit: str) -> str:
    """A unit as the end of a name, such as _rad_per_s2; nothing for none."""
    spelled = unit.replace("^", "").replace("**", "").replace("⁻", "-").replace("/", " per ")
    name = _spell(re.sub(r"-(?=\d)", "minus", spelled))
    return f"_{name}" if name else ""


def _variable_names(wanted: Sequence[tuple[str, str]]) -> list[str]:
    """A name for each pair of a stem and a suffix: distinct in any case, and short enough.

    The suffix stays whole; stems that are too long are cut, and those alike are numbered.
    """
    names: list[str] = []
    taken = set(RESERVED)
    for text, suffix in wanted:
        stem = _spell(text)
        stem = stem if stem[:1].isalpha() else f"v_{stem}"
        name, count = stem[: LONGEST - len(suffix)] + suffix, 1
        while name.lower() in taken:
            count += 1
            more = f"_{count}{suffix}"
            name = stem[: LONGEST - len(more)] + more
        taken.add(name.lower())
        names.append(name)
    return names


HEAD = """# Linear mixed models of identified parameters, as skhoid fitted them.
# Run it with: Rscript {script}
# It needs: install.packages(c("lme4", "lmerTest", "pbkrtest"))
# The script stops if R finds other numbers than skhoid.
suppressPackageStartupMessages({{library(lme4); library(lmerTest)}})

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
same("{what}", tests$Estimate, {estimate}, {se})
same("standard errors of {what}", tests[["Std. Error"]], {se})
same("df of {what}", tests$df, {df})
"""

OMNIBUS = """
L <- cbind(-1, diag({n} - 1))
omnibus <- contest(again, L, joint = TRUE, ddf = "Kenward-Roger")
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


def _section(result: MixedModelResult) -> str:
    conditions = [str(name) for name in result.effects["condition"]]
    fixed = "0 + condition" if len(conditions) > 1 else "1"
    mean, mean_se = (result.effects[name].to_numpy(dtype=float) for name in ("mean", "se"))
    if result.transform == "log":
        mean, mean_se = np.log(mean), mean_se / mean
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
    return MODEL.format(
        parameter=_line(result.parameter),
        unit=f", {_line(result.unit)}" if result.unit else "",
        scale=", as logarithm" if result.transform == "log" else "",
        name=_quoted(result.parameter),
        levels=f"c({', '.join(map(_quoted, conditions))})",
        tau=result.tau,
        fit=fit,
    )


def _tests(result: MixedModelResult, mean: np.ndarray, se: np.ndarray) -> str:
    conditions = list(result.effects["condition"])
    n = len(conditions)
    text = _test("means of conditions", f"diag({n})", mean, se, result.effects["df"])
    if result.omnibus is None:
        return text
    contrasts = result.contrasts
    L = np.zeros((len(contrasts), n), dtype=int)
    for row, condition, against in zip(
        L, contrasts["condition"], contrasts["against"], strict=True
    ):
        row[conditions.index(condition)], row[conditions.index(against)] = 1, -1
    matrix = f"matrix(c({', '.join(map(str, L.ravel()))}), ncol = {n}, byrow = TRUE)"
    text += _test("contrasts", matrix, *(contrasts[k] for k in ("difference", "se", "df")))
    return text + OMNIBUS.format(n=n, F=float(result.omnibus.F), df2=float(result.omnibus.df2))


def _test(what: str, L: str, estimate: Any, se: Any, df: Any) -> str:
    numbers = {"estimate": _vector(estimate), "se": _vector(se), "df": _vector(df)}
    return TESTS.format(what=what, L=L, **numbers)


def _vector(values: Any) -> str:
    return f"c({', '.join(repr(float(value)) for value in values)})"


def _line(text: Any) -> str:
    """Text that cannot leave its comment."""
    return " ".join(str(text).split())


def _quoted(text: Any) -> str:
    """A string of R."""
    escaped = str(text).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


LONG, SCRIPT = "parameters_long.csv", "mixed_models.R"
COLUMNS = ["parameter", "unit", "subject", "condition", "run", "estimate", "se"]
COLUMNS += ["value", "value_se", "weight", "cell_weight", "used", "left_out", "outlying", "failure"]


def write_long(
    results: MixedModelResult | Sequence[MixedModelResult],
    folder: str | Path,
    *,
    overwrite: bool = False,
) -> tuple[Path, Path]:
    """Write all rows to a CSV file, and an R script that reproduces the mixed models.

    Parameters
    ----------
    results : MixedModelResult or sequence of MixedModelResult
        Of :func:`mixed_model`, one for each parameter.
    folder : str or Path
        Folder of the two files; it is made if need be.
    overwrite : bool, default=False
        Whether files that are there are replaced.

    Returns
    -------
    csv, script : Path
        ``parameters_long.csv`` and ``mixed_models.R``.

    Raises
    ------
    FileExistsError
        If one of the files is there, and ``overwrite`` is False. Nothing is written then.
    ValueError
        If there is no result, or there are several of one parameter.

    Notes
    -----
    The CSV file has dots for decimals, UTF-8, and a column ``unit``, as parameters differ in it.
    ``value`` is the estimate on the scale of the model, ``weight`` the share of the run in its
    person and condition, ``cell_weight`` the weight of these, with the mean 1; ``used`` is 1 or 0,
    and ``left_out`` says why. The script needs lme4, lmerTest and pbkrtest. It stops if a
    number of R differs from the one written by more than 1e-4 of it (or of its standard error,
    where that is larger). pbkrtest takes no notice of weights: the script therefore fits the same
    model twice, with weights, and with all columns times their square roots.

    Examples
    --------
    >>> import tempfile
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import mixed_model, write_long
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabbccdd"),
    ...         "condition": ["C1", "C2"] * 4,
    ...         "run": 1,
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...     }
    ... ).assign(parameter="tau_e", unit="s", se=0.01, outlying="", failure="")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_long(mixed_model(table, "tau_e"), folder)]
    ['parameters_long.csv', 'mixed_models.R']
    """
    results = [results] if isinstance(results, MixedModelResult) else list(results)
    names = [result.parameter for result in results]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"One result of each parameter is needed; got {names}.")
    csv, script = Path(folder) / LONG, Path(folder) / SCRIPT
    _refuse_existing([csv, script], overwrite)
    # Fits that failed have no parameter of their own.
    rows = pd.concat([r.data.assign(parameter=r.parameter) for r in results], ignore_index=True)
    rows["used"] = (rows["left_out"] == "").astype(int)
    text = HEAD.format(script=SCRIPT, csv=LONG) + "".join(map(_section, results))
    csv.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(csv) as first, written_whole(script) as second:
        rows[COLUMNS].to_csv(first, index=False, encoding="utf-8", float_format="%.17g")
        second.write_text(f'{text}\ncat("R and skhoid agree.\\n")\n', encoding="utf-8")
    return csv, script


def write_wide(table: pd.DataFrame, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a row for each person, with a column for each parameter and condition.

    Parameters
    ----------
    table : DataFrame
        Tidy table of parameters.
    path : str or Path
        CSV file to write.
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
    ...         "estimate": [0.21, 0.24, 0.25, 0.29],
    ...     }
    ... ).assign(parameter="tau_e", unit="s", se=0.01, outlying="", failure="")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_wide(table, Path(folder) / "wide.csv")
    ...     print(path.read_text(encoding="utf-8-sig"))
    subject,tau_e_C1_s,tau_e_C2_s
    a,0.21,0.24
    b,0.25,0.29
    """
    path = Path(path)
    _refuse_existing([path], overwrite)
    wide = pd.DataFrame({"subject": table["subject"].unique()})
    wanted = [("subject", "")]
    for name in filter(None, table["parameter"].fillna("").unique()):
        rows = select(table, name)
        means = rows.used.pivot_table(index="subject", columns="condition", values="estimate")
        for condition in rows.conditions:
            label = "" if condition == ALL else f"_{condition}"
            wanted.append((f"{name}{label}", _unit_suffix(rows.unit)))
            wide[len(wanted)] = wide["subject"].map(means[condition])
    wide.columns = _variable_names(wanted)
    with written_whole(path) as aside:
        wide.to_csv(aside, index=False, encoding="utf-8-sig", float_format="%.12g")
    return path


def _refuse_existing(paths: Sequence[Path], overwrite: bool) -> None:
    there = [str(path) for path in paths if path.exists()]
    if there and not overwrite:
        raise FileExistsError(
            f"{' and '.join(there)} would be replaced: name another place, or use overwrite=True."
        )
