"""Grades of answers, and the table of a suite.

``grade`` makes one flat record of a case and its answer; everything else is made of records, so
that a trial that was broken off can still be read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from baseline import vaf
from generator import Case
from sets import COHERENT, NEAR, NONE, UNKNOWN, right_answers, right_without
from shapes import Shape, grade_shape, shape_rows
from tables import quantiles, share

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
OPERATOR = ("K_e", "K_edot", "tau_e", "omega_nm", "zeta_nm")
ELSEWHERE = {"extra_lag", "extra_lead", "nm_mode", "higher_order", "gain_drift", "scheduled_gain"}
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
        Of the operator by name, of effects by ``effect__parameter``: value, and the ends of the
        95 % interval.
    baseline_vaf : float or None
        What the search says of the model that nothing was added to, on held-out training rows.
    forms : dict
        Form of each effect that has some.
    left : dict
        Points of VAF of each structure that no effect explains.
    shape : Shape or None
        Of what no name fits.
    """

    names: list[str]
    ranking: list[str]
    prediction: np.ndarray
    seconds: float
    explainable_gap: float | None = None
    parameters: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    baseline_vaf: float | None = None
    forms: dict[str, str | None] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    shape: Shape | None = None

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
        **grade_shape(case, answer.shape),
    }
    if case.gap >= 1:
        record["closed"] = (reached - case.baseline_vaf) / case.gap
    if answer.baseline_vaf is not None and answer.explainable_gap is not None:
        true = case.oracle_vaf_of_training - answer.baseline_vaf
        record["gap_error"] = answer.explainable_gap - true
    canonical = truth["canonical"]
    if case.suite == "null":
        record["operator"] = _operator(case, answer)
        record["right"] = record["strict"] = not answer.names
    elif case.suite == "pairs":
        sets = [right_answers(name, 2.0) for name in names]
        found = set(answer.names)
        record["strict"] = set(names) <= found
        record["right"] = _both(sets, answer.names)
        record["one"] = any(found & right for right in sets)
        record["exactly"] = record["right"] and len(answer.names) == 2
        record["worth"] = truth["worth"]
        if canonical and set(answer.names) == set(names):
            record["parameters"] = _parameters(case, answer)
            record["operator"] = _operator(case, answer)
    elif case.suite == "left_out":
        record["strict"] = answer.first == UNKNOWN
        record["right"] = answer.first in right_without(names[0])
    elif case.suite == "beyond":
        record["strict"] = answer.first == UNKNOWN
        record["right"] = record["strict"] or answer.first in NEAR.get(names[0], ())
    else:
        record["strict"] = answer.first == names[0]
        record["right"] = answer.first in right_answers(names[0], case.gap)
        record["more"] = len(answer.names) > 1
        if canonical and answer.first == names[0]:
            record["parameters"] = _parameters(case, answer)
        if canonical and answer.names == names:
            record["operator"] = _operator(case, answer)
    return record


def _both(sets: list[frozenset[str]], names: list[str]) -> bool:
    """Whether two different answers serve the two sets."""
    one, other = ([i for i, name in enumerate(names) if name in right] for right in sets)
    return any(i != j for i in one for j in other)


def _parameters(case: Case, answer: Answer) -> dict[str, dict[str, Any]]:
    """True and estimated values of the named effects, and a form where that is another."""
    graded: dict[str, dict[str, Any]] = {}
    for name in case.truth["effects"]:
        own = case.truth["parameters"][name]
        said = {
            full.split("__", 1)[1]: value
            for full, (value, *_) in answer.parameters.items()
            if full.startswith(f"{name}__")
        }
        true = own
        if name in TRUE:
            true = {parameter: of(own, case, said) for parameter, of in TRUE[name].items()}
        form = answer.forms.get(name)
        for parameter, value in true.items():
            if parameter == "rate" and "t_M" in own and value > STEP:
                continue
            full = f"{name}__{parameter}"
            graded[full] = _interval(value, answer.parameters.get(full))
            if form is not None and form not in FORMS.get(name, (form,)):
                graded[full]["form"] = form
    return graded


def _interval(true: float, said: tuple[float, float, float] | None) -> dict[str, Any]:
    value, low, high = said or (np.nan, np.nan, np.nan)
    return {"true": true, "value": value, "low": low, "high": high}


def _operator(case: Case, answer: Answer) -> dict[str, dict[str, Any]]:
    """True and estimated parameters of the operator, where the two mean the same.

    Linear effects share the dynamics with the operator, and the catalogue's gain at a reference of
    time or of a channel is not the trial's. A delay that the user gives has no interval.
    """
    if set(case.truth["effects"]) & ELSEWHERE:
        return {}
    own = case.truth["operator"]
    true = {**own, "tau_e": own["tau"]}
    return {
        name: _interval(true[name], answer.parameters[name])
        for name in OPERATOR
        if name in answer.parameters
    }


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
    suites = {"null": _null, "pairs": _pairs, "left_out": _left_out, "beyond": _beyond}
    rows = suites.get(suite, _single)(records) + _interval_rows(records) + shape_rows(records)
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
    times = f"{quantiles(seconds)} / {max(seconds):.2f}"
    rows.append(("seconds a case: median, 90 %, max", times))
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
    more = [r["more"] for r in records if r["right"] and r["gap"] >= 3]
    rows.append(("a second name that is not there, strong and medium, first right", share(more)))
    rows.append(("none or unknown first", share(r["first"] in (NONE, UNKNOWN) for r in records)))
    return rows


def _interval_rows(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """How often 95 % intervals hold the truth: of the effects named, and of the operator."""
    rows = _parameter_rows(records) if any("parameters" in r for r in records) else []
    operator: dict[str, list[bool]] = {}
    for record in records:
        for name, p in record.get("operator", {}).items():
            if p["high"] > p["low"]:
                operator.setdefault(name, []).append(bool(p["low"] <= p["true"] <= p["high"]))
    if operator:
        together = [held for each in operator.values() for held in each]
        rows.append(("95 % intervals of the operator that cover the truth", share(together)))
        rows += [(f"... {name}", share(held)) for name, held in operator.items()]
    return rows


def _parameter_rows(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    errors, inside, absent = [], [], []
    graded = [(name, p) for r in records for name, p in r.get("parameters", {}).items()]
    for name, p in graded:
        if "form" in p:
            continue
        if not np.isfinite(p["value"]):
            absent.append(name)
            continue
        small = SMALL if name.split("__")[1] in ("delay", "time") else 0.0
        errors.append(100 * abs(p["value"] - p["true"]) / max(abs(p["true"]), small))
        if np.isfinite(p["low"]) and np.isfinite(p["high"]):
            inside.append(p["low"] <= p["true"] <= p["high"])
    return [
        ("parameter error, %: median, 90 %", quantiles(errors, ".1f")),
        ("95 % intervals that cover the truth", share(inside)),
        ("parameters of another form than the truth's", share("form" in p for _, p in graded)),
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
    third = [len(r["names"]) > 2 for r in records if r["right"]]
    rows.append(("a third name that is not there, both named", share(third)))
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


def _beyond(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    named = [r for r in records if r["first"] not in (NONE, UNKNOWN)]
    near, other = ([r for r in named if r["right"] is right] for right in (True, False))
    return [
        ("unknown or a near name", share(r["right"] for r in records)),
        ("... unknown", share(r["strict"] for r in records)),
        ("... none", share(r["first"] == NONE for r in records)),
        ("... another name", share(r in other for r in records)),
        ("a near name that closes 0.9 of the gap", share(r["closed"] >= 0.9 for r in near)),
        ("another name that does", share(r["closed"] >= 0.9 for r in other)),
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
            "shapes": _shapes_of(own),
            "instead": ", ".join(f"{n} {other}" for other, n in counts.items()),
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def _shapes_of(records: list[dict[str, Any]]) -> str:
    """How often which shape was offered, with a star where it is right."""
    marks = [f"{s['id']} {s['place']}{'*' * s['right']}" for r in records if (s := r["shape"])]
    return ", ".join(
        f"{n} {mark}" for mark, n in pd.Series(marks, dtype=object).value_counts().items()
    )


def confusion(records: list[dict[str, Any]]) -> pd.DataFrame:
    """Counts of the first name (columns) for each effect (rows)."""
    single = [r for r in records if len(r["effects"]) <= 1]
    true = pd.Series([r["effects"][0] if r["effects"] else NONE for r in single], name="effect")
    said = pd.Series([r["first"] for r in single], name="named")
    return pd.crosstab(true, said)
