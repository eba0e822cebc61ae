"""The R script that reproduces mixed models, with their numbers, and stops where R differs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._model import SUBJECT
from .result import MixedModelResult

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
    if SUBJECT not in set(result.variances["source"]):
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
