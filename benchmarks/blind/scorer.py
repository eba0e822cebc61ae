"""Grades of answers, and the table of a suite.

``grade`` makes one flat record of a case and its answer; everything else is made of records, so
that a trial that was broken off can still be read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from baseline import vaf
from generator import Case
from scipy.stats import beta
from sets import COHERENT, NONE, UNKNOWN, right_answers, right_without

N_SAMPLES = 8192

# What a parameter of the answer must be, from the truth's parameters, the case and what the answer
# says of the effect; an effect that is not here has the same names in both.
OfTruth = Callable[[dict[str, Any], Case, dict[str, float]], float]
TRUE: dict[str, dict[str, OfTruth]] = {
    "tv_delay": {
        "change": lambda p, case, said: p["change"],
        "rate": lambda p, case, said: p["G"],
        "time": lambda p, case, said: p["t_M"],
    },
    # The trial's gains act when the error is answered, the catalogue's when it is seen.
    "tv_gain": {
        "K_e_change": lambda p, case, said: p["K_e_factor"] - 1,
        "K_edot_change": lambda p, case, said: p["K_edot_factor"] - 1,
        "rate": lambda p, case, said: p["G"],
        "time": lambda p, case, said: p["t_M"] - case.truth["operator"]["tau"],
    },
    "gain_drift": {
        "rate": lambda p, case, said: p["rate"] / (1 + p["rate"] * case.truth["operator"]["tau"]),
    },
    "scheduled_gain": {"slope": lambda p, case, said: p["slope"] / _at_reference(p, case)},
    "lapses": {},
    "rectified": {},
    "cubic_gain": {"hardening": lambda p, case, said: p["cubic"]},
    "stiction": {
        "breakaway": lambda p, case, said: p["breakaway"],
        "kinetic": lambda p, case, said: p["kinetic"] / p["breakaway"],
    },
    "tremor": {"frequency": lambda p, case, said: p["frequency"]},
    # Two pairs of poles in series: which of them is the effect's, nothing tells.
    "nm_mode": {
        "omega": lambda p, case, said: _nearest_mode(p, case, said)[0],
        "zeta": lambda p, case, said: _nearest_mode(p, case, said)[1],
    },
    "extra_lag": {"time": lambda p, case, said: p["T_I"]},
    "extra_lead": {"time": lambda p, case, said: p["T"]},
    "higher_order": {
        "zero_frequency": lambda p, case, said: p["omega"],
        "zero_damping": lambda p, case, said: p["zeta_zeros"],
        "pole_frequency": lambda p, case, said: _nearest_mode(p, case, said)[0],
        "pole_damping": lambda p, case, said: _nearest_mode(p, case, said)[1],
    },
}
# Forms whose parameters are those of the trial's canonical form; those of others mean other things.
FORMS = {
    "asym_gain": ("all",),
    "dead_zone": ("gap",),
    "cubic_gain": ("cubic",),
    "quantised": ("sharp", "behind"),
    "hardening_stiffness": ("cubic",),
    "drift": ("linear",),
    "feedforward": ("inverse",),
    "preview": ("inverse",),
    "motion_feedback": ("direct",),
    "cross_axis": ("error",),
    "tv_gain": ("sigmoid",),
    "gain_drift": ("linear",),
    "stiction": ("jump",),
    "absolute_value": ("together",),
}
SETTLING = 3.0  # s; before it nothing counts for the catalogue's reference of a channel
STEP = 5.0  # 1/s; a sigmoid as steep is practically a step and has no rate
SMALL = 0.1  # s; errors of delays are in percent of this at least, as a delay may be zero


@dataclass(frozen=True)
class Answer:
    """What the search says about a case.

    Parameters
    ----------
    names : list of str
        Effects in the order added; empty for none, "unknown" for something not in the catalogue.
    ranking : list of str
        All candidates of the first step, best first.
    prediction : ndarray of shape (n_rows,)
        For X_test.
    seconds : float
        Time of fit and predict.
    explainable_gap : float or None
        Points of VAF that a better model can gain over ``baseline_vaf`` on the training runs.
    parameters : dict
        ``effect__parameter``: value and standard deviation.
    baseline_vaf : float or None
        What the search says of the model that nothing was added to, on held-out training rows.
    forms : dict
        Form of each effect that has some.
    left : dict
        Points of VAF of each structure that no effect explains.
    """

    names: list[str]
    ranking: list[str]
    prediction: np.ndarray
    seconds: float
    explainable_gap: float | None = None
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)
    baseline_vaf: float | None = None
    forms: dict[str, str | None] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)

    @property
    def first(self) -> str:
        return self.names[0] if self.names else NONE


def strength(case: Case) -> str:
    """Of the effect: strong, medium or weak by its gap, or that it has none."""
    if case.gap < 1:
        return "no gap"
    return "strong" if case.gap > 10 else "medium" if case.gap >= 3 else "weak"


def grade(case: Case, answer: Answer) -> dict[str, Any]:
    """One flat record of a case and its answer.

    Parameters
    ----------
    case : Case
    answer : Answer

    Returns
    -------
    record : dict
        Ready for JSON.
    """
    u = case.y_test.to_numpy().reshape(-1, N_SAMPLES)
    reached = vaf(u, np.asarray(answer.prediction, dtype=float).reshape(u.shape))
    truth, names = case.truth, case.truth["effects"]
    record: dict[str, Any] = {
        "suite": case.suite,
        "number": case.number,
        "seed": case.seed,
        "effects": names,
        "form": list(truth["form"].values()),
        "canonical": truth["canonical"],
        "variant": truth["variant"],
        "strength": strength(case),
        "P_n": truth["P_n"],
        "plant": truth["plant"],
        "oracle_vaf": case.oracle_vaf,
        "ceiling_vaf": case.ceiling_vaf,
        "baseline_vaf": case.baseline_vaf,
        "gap": case.gap,
        "vaf": reached,
        "names": answer.names,
        "first": answer.first,
        "ranking": answer.ranking[:5],
        "seconds": answer.seconds,
        "explainable_gap": answer.explainable_gap,
        "left": answer.left,
        "above_oracle": reached - case.oracle_vaf,
        "above_ceiling": reached - case.ceiling_vaf,
    }
    if case.gap >= 1:
        record["closed"] = (reached - case.baseline_vaf) / case.gap
    if answer.baseline_vaf is not None and answer.explainable_gap is not None:
        true = case.oracle_vaf_of_training - answer.baseline_vaf
        record["gap_error"] = answer.explainable_gap - true
    if case.suite == "null":
        record["right"] = record["strict"] = not answer.names
    elif case.suite == "pairs":
        sets = [right_answers(name, 2.0) for name in names]
        found = set(answer.names)
        record["strict"] = set(names) <= found
        record["right"] = _both(sets, answer.names)
        record["one"] = any(found & right for right in sets)
        record["exactly"] = record["right"] and len(answer.names) == 2
        record["worth"] = truth["worth"]
    elif case.suite == "left_out":
        record["strict"] = answer.first == UNKNOWN
        record["right"] = answer.first in right_without(names[0])
    else:
        record["strict"] = answer.first == names[0]
        record["right"] = answer.first in right_answers(names[0], case.gap)
        record["more"] = len(answer.names) > 1
        if truth["canonical"] and answer.first == names[0]:
            record["parameters"] = _parameters(case, answer)
    return record


def _both(sets: list[frozenset[str]], names: list[str]) -> bool:
    """Whether two different answers serve the two sets."""
    one, other = ([i for i, name in enumerate(names) if name in right] for right in sets)
    return any(i != j for i in one for j in other)


def _parameters(case: Case, answer: Answer) -> dict[str, dict[str, Any]]:
    """True and estimated values of the named effect, and its form where that is another."""
    (name,) = case.truth["effects"]
    own = case.truth["parameters"][name]
    said = {
        full.split("__", 1)[1]: value
        for full, (value, _) in answer.parameters.items()
        if full.startswith(f"{name}__")
    }
    if name in TRUE:
        true = {parameter: of(own, case, said) for parameter, of in TRUE[name].items()}
    else:
        true = own
    form = answer.forms.get(name)
    graded: dict[str, dict[str, Any]] = {}
    for parameter, value in true.items():
        if parameter == "rate" and "t_M" in own and value > STEP:
            continue
        found, sd = answer.parameters.get(f"{name}__{parameter}", (np.nan, np.nan))
        graded[parameter] = {"true": value, "value": found, "sd": sd}
        if form is not None and form not in FORMS.get(name, (form,)):
            graded[parameter]["form"] = form
    return graded


def _at_reference(p: dict[str, Any], case: Case) -> float:
    """The trial's gain where the catalogue's is one: at the mean of the channel where it counts."""
    speed = case.X["speed"]
    counts = speed.index.get_level_values("time").to_numpy() >= SETTLING
    return 1 + p["slope"] * float(speed[counts].mean() - speed.mean())


def _nearest_mode(p: dict[str, Any], case: Case, said: dict[str, float]) -> tuple[float, float]:
    """Frequency and damping of the poles, or of the operator's own if those are nearer."""
    own = case.truth["operator"]
    zeta = p["zeta"] if "zeta" in p else p["zeta_poles"]
    modes = [(p["omega"], zeta), (own["omega_nm"], own["zeta_nm"])]
    omega = said.get("omega", said.get("pole_frequency", p["omega"]))
    return min(modes, key=lambda mode: abs(np.log(mode[0] / omega)))


def clopper_pearson(k: int, n: int) -> tuple[float, float]:
    """The exact 95 % interval of a share of k in n, in percent."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return 100 * float(low), 100 * float(high)


def share(values: Iterable[bool]) -> str:
    """A percentage with its interval and counts."""
    values = list(values)
    k, n = sum(map(bool, values)), len(values)
    if not n:
        return "no cases"
    low, high = clopper_pearson(k, n)
    return f"{100 * k / n:.1f} % [{low:.1f}, {high:.1f}] ({k}/{n})"


def table(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Figures of a suite, each with its name.

    Parameters
    ----------
    records : list of dict
        From ``grade``, of one suite.

    Returns
    -------
    rows : list of (str, str)
    """
    suite = records[0]["suite"]
    rows = {"null": _null, "pairs": _pairs, "left_out": _left_out}.get(suite, _single)(records)
    gaps = [r for r in records if "gap_error" in r]
    if gaps:
        rows.append(("explainable gap, rms error", _rms([r["gap_error"] for r in gaps])))
        coherent = [r for r in gaps if r["effects"] and set(r["effects"]) <= COHERENT]
        rows.append(("... of coherent effects", _rms([r["gap_error"] for r in coherent])))
    named = [r["vaf"] - r["baseline_vaf"] - r["gap"] for r in records if r["gap"] >= 1]
    if named:
        rows.append(("gap closed after naming, rms error", _rms(named)))
    above = [r["above_oracle"] for r in records]
    rows.append(("predictions > 1 point above the oracle", share(a > 1 for a in above)))
    over = [r["above_ceiling"] for r in records]
    rows.append(
        ("... above the mean answer too", f"{share(a > 1 for a in over)}, max {max(over):.2f}")
    )
    seconds = [r["seconds"] for r in records]
    quantiles = np.percentile(seconds, [50, 90, 100])
    rows.append(("seconds a case: median, 90 %, max", " / ".join(f"{q:.2f}" for q in quantiles)))
    return rows


def _rms(values: list[float]) -> str:
    if not values:
        return "no cases"
    return f"{np.sqrt(np.mean(np.square(values))):.2f} points, mean {np.mean(values):+.2f}"


def _single(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Suites main and one_run."""

    def by(choice: Callable[[dict[str, Any]], bool], what: str = "right") -> str:
        return share(r[what] for r in records if choice(r))

    rows = []
    groups: dict[str, Callable[[dict[str, Any]], bool]] = {
        "strong and medium": lambda r: r["strength"] in ("strong", "medium"),
        "strong": lambda r: r["strength"] == "strong",
        "medium": lambda r: r["strength"] == "medium",
        "weak": lambda r: r["strength"] == "weak",
        "no gap": lambda r: r["strength"] == "no gap",
        "form of the catalogue": lambda r: r["canonical"] and r["gap"] >= 1,
        "other forms": lambda r: not r["canonical"] and r["gap"] >= 1,
        "other forms, strong and medium": lambda r: not r["canonical"] and r["gap"] >= 3,
    }
    for name, choice in groups.items():
        rows.append((f"right name first, {name}", by(choice)))
        rows.append(("... without sets", by(choice, "strict")))
    large = [r["closed"] for r in records if r["gap"] >= 3]
    if large:
        rows.append(
            ("share of the gap closed, strong and medium", f"median {np.median(large):.3f}")
        )
        rows.append(("... at least 0.9", share(c >= 0.9 for c in large)))
    rows.append(("more than one effect named", share(r["more"] for r in records)))
    rows.append(("none or unknown first", share(r["first"] in (NONE, UNKNOWN) for r in records)))
    return [*rows, *_parameter_rows(records)]


def _parameter_rows(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    errors, inside, absent = [], [], []
    graded = [p for r in records for p in r.get("parameters", {}).values()]
    other = ("parameters of another form than the truth's", share("form" in p for p in graded))
    for record in records:
        for name, p in record.get("parameters", {}).items():
            if "form" in p:
                continue
            if not np.isfinite(p["value"]):
                absent.append(f"{record['effects'][0]}__{name}")
                continue
            error = abs(p["value"] - p["true"])
            small = SMALL if name in ("delay", "time") else 0.0
            errors.append(100 * error / max(abs(p["true"]), small))
            if np.isfinite(p["sd"]):
                inside.append(error <= 1.96 * p["sd"])
    if not errors:
        return [("parameters not found in the answer", ", ".join(sorted(set(absent))) or "none")]
    quantiles = np.percentile(errors, [50, 90])
    return [
        ("parameter error, %: median, 90 %", " / ".join(f"{q:.1f}" for q in quantiles)),
        ("95 % intervals that cover the truth", share(inside)),
        other,
        ("parameters not found in the answer", ", ".join(sorted(set(absent))) or "none"),
    ]


def _null(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    rows = [("false alarms", share(not r["right"] for r in records))]
    named = [bool(r["names"]) and r["first"] != UNKNOWN for r in records]
    rows.append(("... with a name", share(named)))
    for variant in dict.fromkeys(r["variant"] for r in records):
        rows.append(
            (f"... {variant}", share(not r["right"] for r in records if r["variant"] == variant))
        )
    return rows


def _pairs(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    rows = []
    for what, name in (
        ("right", "both named"),
        ("strict", "... without sets"),
        ("exactly", "... and nothing else"),
        ("one", "at least one"),
    ):
        rows.append((name, share(r[what] for r in records)))
    for what, chosen in (("both", True), ("not both", False)):
        name = f"both named, {what} of the catalogue's form"
        rows.append((name, share(r["right"] for r in records if r["canonical"] is chosen)))
    strong = [r["right"] for r in records if min(r["worth"]) >= 3]
    rows.append(("both named, each worth 3 points", share(strong)))
    closed = [r["closed"] for r in records]
    rows.append(("share of the gap closed", f"median {np.median(closed):.3f}"))
    rows.append(("... at least 0.9", share(c >= 0.9 for c in closed)))
    return rows


def _left_out(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    gap = [r for r in records if r["gap"] >= 1]
    return [
        ("unknown or a physically equal family", share(r["right"] for r in gap)),
        ("... unknown", share(r["strict"] for r in gap)),
        ("... none", share(r["first"] == NONE for r in gap)),
        ("... a wrong name", share(not r["right"] and r["first"] != NONE for r in gap)),
    ]


def by_effect(records: list[dict[str, Any]]) -> pd.DataFrame:
    """One row for each effect: cases, shares of right answers, gap closed, wrong answers."""
    rows = {}
    single = [r for r in records if len(r["effects"]) == 1]
    for name in dict.fromkeys(r["effects"][0] for r in single):
        own = [r for r in single if r["effects"][0] == name]
        wrong = [r["first"] for r in own if not r["right"]]
        closed = [r["closed"] for r in own if "closed" in r]
        counts = pd.Series(wrong, dtype=object).value_counts()
        rows[name] = {
            "right": share(r["right"] for r in own),
            "strict": f"{100 * np.mean([r['strict'] for r in own]):.0f} %",
            "other forms": share(r["right"] for r in own if not r["canonical"]),
            "closed": f"{np.median(closed):.2f}" if closed else "",
            "instead": ", ".join(f"{n} {other}" for other, n in counts.items()),
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def confusion(records: list[dict[str, Any]]) -> pd.DataFrame:
    """Counts of the first name (columns) for each effect (rows)."""
    single = [r for r in records if len(r["effects"]) <= 1]
    true = pd.Series([r["effects"][0] if r["effects"] else NONE for r in single], name="effect")
    said = pd.Series([r["first"] for r in single], name="named")
    return pd.crosstab(true, said)
