"""What a report says: tables and sentences from results, ready for the template."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ...diagnosis import Comparison
from ...effects import catalogue, titles_of
from ...pipelines import raw_layout, taken_apart
from ...preprocessing import as_fitted, as_output
from ...recordings import check_channels
from ...regression import units_of
from ...runs import RunLayout, as_frame, output_name, roles_of, run_name
from ...search import (
    BY_HAND,
    HOW_TO_GO_ON,
    LEAST_GAIN,
    THRESHOLD,
    EffectSearchCV,
    Shape,
    Status,
    limits_table,
    tell_baseline,
    tell_headline,
    tell_no_name,
    tell_stand_ins,
    tell_step,
    unexplained_by,
    with_effects,
)
from ...text import (
    DASH,
    VAF_RULE,
    Estimate,
    Facts,
    Note,
    Step,
    TextTable,
    as_sentence,
    ceiling_text,
    counted,
    gap_text,
    number,
    tell,
)
from ..explore.payloads import pack_text
from .page import advise, provenance
from .plots import Gallery, Plot

Say = Callable[[Note | str], str]  # to who writes Python, or who types commands

NEAREST = "Nearest names. Distance 0: the same curve; 1: nothing in common"
MANY = 40  # runs in a table
DRAWN = 8  # channels
BEST = 5  # candidates of a step, before those that are folded
SECTIONS = {
    "steps": "The error, step by step",
    "explore": "Look for yourself",
    "shape": "The shape of what has no name",
    "parameters": "Parameters",
    "models": "Models side by side",
    "next": "What to do next",
    "ranking": "Ranking, with reasons",
    "comparison": "Comparison with the measurement",
    "data": "Data",
    "model": "Model",
    "made": "How this was made",
}
FOLDED = ("ranking", "comparison", "data", "model", "made")  # of a search, whose result is first
# Findings of a comparison that are settled by a search of the whole catalogue.
ANSWERED = (
    "asymmetry",
    "bias",
    "cross-correlation",
    "delay",
    "distortion",
    "gain",
    "gain change",
    "lag",
    "mean change",
    "nonlinearity",
    "unknown",
)


@dataclass(frozen=True, kw_only=True)
class Results:
    """What a report is made of: models, the search for effects, comparisons (or why none).

    ``final`` and ``after`` are the model and the comparison with the effects found, or as a user
    has made it; ``final_name`` is what it has more than the baseline. ``models`` are that of an
    exploration and those kept beside it, ``held_out`` the runs that it holds out.
    """

    baseline: Any
    final: Any = None
    final_name: str = ""
    search: EffectSearchCV | None = None
    no_search: str = ""
    fitted_here: bool = False
    comparison: Comparison | None = None
    no_comparison: str = ""
    after: Comparison | None = None
    models: Sequence[Mapping[str, Any]] = ()
    held_out: str = ""


def read_content(
    X: Any,
    y: Any,
    results: Results,
    payload: dict[str, Any] | None,
    *,
    source: str | None,
    made_with: dict[str, str] | None,
) -> dict[str, Any]:
    """Everything the template shows."""
    baseline, final, search = results.baseline, results.final, results.search
    comparison, after = results.comparison, results.after
    rows = "the rows it was fitted to" if results.fitted_here else "the rows given"
    frame = as_frame(X)
    output = pd.Series(as_output(y), name=output_name(y))
    units = {**units_of(X), **units_of(y)}
    layout = raw_layout(baseline, X)
    names = [*frame.columns, output.name, *units.values(), repr(baseline), *layout.labels]
    gallery = Gallery(map(str, names))
    say = partial(tell, typed="command" in (made_with or {}))
    added = results.final_name
    compared = [
        {
            "title": title,
            "folded": found is comparison and after is not None,
            "rows": rows,
            "figures": _figures(found),
            "findings": list(_findings(found, None if found is after else after, added, say)),
            "notes": [as_sentence(say(note)) for note in found.notes],
            "false_alarm": f"{100 * found.false_alarm:g}",
            "pictures": gallery.comparison(found),
        }
        for title, found in (
            (as_sentence(added).rstrip("."), after),
            ("Before the search", comparison),
        )
        if found is not None
    ]
    content = {
        "in_short": _in_short(search, comparison),
        "vaf_rule": VAF_RULE,
        "verdict": _verdict(search, comparison),
        "facts": [*_facts(search, comparison, rows), *_facts_now(results)],
        "source": source,
        "data": _data(X, y, frame, output, units, baseline, layout, comparison, after, gallery),
        "model": _model(baseline),
        "compared": compared,
        "no_comparison": results.no_comparison,
        "steps": [] if search is None else _steps(search, gallery),
        "shape": None if search is None else _shape(search.shape_, gallery),
        "unit": units.get(str(output.name), ""),
        "rankings": [] if search is None else list(_rankings(search)),
        "limits": None if search is None else limits_table(search.result_),
        "no_search": results.no_search,
        "criteria": {"evidence": f"{THRESHOLD:g}", "gain": f"{LEAST_GAIN:g}"},
        "folded": FOLDED if search is not None else (),
        "parameters": _parameters(baseline, final),
        "models": _models(results.models) if len(results.models) > 1 else None,
        "with_before": final is not None,
        "effects": [] if final is None else gallery.effects(final, X, y),
        "paths": _paths(baseline, gallery),
        "next_steps": list(_next_steps(results, say)),
        "made": provenance(search if search is not None else baseline, X, y, made_with),
        **embed(payload),
    }
    parts = {id: content.get(id, True) for id in SECTIONS} | {"explore": content["payload"]}
    parts["ranking"] = content["rankings"]
    content["sections"] = {id: title for id, title in SECTIONS.items() if parts[id]}
    return content


def embed(payload: dict[str, Any] | None) -> dict[str, Any]:
    """What the template needs of what there is to touch: its text, and whether effects change."""
    if payload is None:
        return {"payload": "", "touched": False, "settling": ""}
    view = payload["view"]
    settling = f"{view['settling']:g}" if view["settling"] else ""
    return {"payload": pack_text(payload), "touched": view["can"]["change"], "settling": settling}


def _figures(found: Comparison) -> TextTable:
    """Figures of a comparison, by what they are called."""
    blocks = found.document().blocks
    rows = [[*line] for b in blocks if isinstance(b, Facts) for line in b.facts.items()]
    return TextTable("", ["figure", "value"], rows, left=["figure", "value"])


def _fixed(value: Any, form: str) -> str:
    return format(float(value), form) if np.isfinite(value) else DASH


def _in_short(search: EffectSearchCV | None, comparison: Comparison | None) -> str:
    if search is None:
        return "not compared" if comparison is None else f"VAF {comparison.vaf:.1f} %"
    vaf = search.error_path_["vaf"]
    text = f"{search.verdict_}, held-out VAF {vaf.iloc[0]:.1f}"
    return text + (f" -> {vaf.iloc[-1]:.1f} %" if len(vaf) > 1 else " %")


def _verdict(search: EffectSearchCV | None, comparison: Comparison | None) -> dict[str, Any]:
    """Kind, headline and sentence at the top of the page."""
    if search is None:
        if comparison is None:
            return {"kind": "none", "headline": "The data", "sentences": []}
        first = comparison.findings[0].title if comparison.findings else "No findings"
        top = comparison.noise_ceiling
        ceiling = f", noise ceiling {ceiling_text(top)}" if np.isfinite(top) else ""
        headline = f"VAF {comparison.vaf:.1f} %{ceiling}. {first}."
        return {"kind": "none", "headline": headline, "sentences": []}
    path = search.error_path_
    kind = search.verdict_.kind
    headline = tell_headline(search.result_)
    unit = search.predictions_.attrs.get("units", {}).get("measured", "")
    errors = [number(rmse) for rmse in path["rmse"].iloc[[0, -1]]]
    sentence = "On rows held out of the fit, the root mean square error " + (
        f"falls from {errors[0]} to {errors[1]}" if len(path) > 1 else f"is {errors[0]}"
    )
    sentence = f"{sentence} {unit}".rstrip()
    in_loop = path["vaf_loop"].iloc[[0, -1] if len(path) > 1 else [0]]
    if np.isfinite(in_loop).all():
        figures_in_loop = " and ".join(f"{vaf:.1f} %" for vaf in in_loop)
        sentence += f"; in the closed loop, where the model moves x and e, VAF {figures_in_loop}"
    sentence += "."
    if search.stand_ins_:
        sentence += f" {tell_stand_ins(search.stand_ins_)}."
    unnamed = search.verdict_.leaves_unknown
    if unnamed and len(search.unexplained_):
        sentence += f" Left: {_unexplained(search)}."
    if unnamed:
        sentence += f" {tell_no_name(search.result_)[0]}"
    return {"kind": kind, "headline": headline, "sentences": [sentence]}


def _findings(
    found: Comparison, after: Comparison | None, added: str, say: Say
) -> Iterator[dict[str, str]]:
    """Findings of a comparison, and which of them are gone with the effects found."""
    left = None if after is None else {finding.name for finding in after.findings}
    for finding in found.findings:
        gone = left is not None and finding.name not in left
        yield {
            "title": finding.title,
            "evidence": finding.evidence,
            "meaning": finding.meaning,
            "next_step": "" if gone else say(finding.next_step),
            "explained": f"Explained {added.replace('with', 'by', 1)}." if gone else "",
        }


def _unexplained(search: EffectSearchCV) -> str:
    return "; ".join(
        f"{row['description']} ({row['where']}, {row['points']:.1f} points)"
        for _, row in search.unexplained_.iterrows()
    )


def _facts(
    search: EffectSearchCV | None, comparison: Comparison | None, rows: str
) -> Iterator[tuple[str, str, str]]:
    """Figures at the top: value, what it is, and a remark."""
    if search is not None:
        path = search.error_path_
        first, last = path.iloc[0], path.iloc[-1]
        yield f"{first['vaf']:.1f} %", "VAF of the baseline", "held-out rows"
        if len(path) > 1:
            yield f"{last['vaf']:.1f} %", "VAF with the effects found", "held-out rows"
        if np.isfinite(last["vaf_loop"]):
            which = "the last model" if len(path) > 1 else "the baseline"
            yield f"{last['vaf_loop']:.1f} %", "VAF in the closed loop", f"held-out rows, {which}"
        if np.isfinite(last["ceiling"]):
            top = "what a model could reach on held-out rows, judged after the last step"
            yield ceiling_text(float(last["ceiling"])), "noise ceiling", top
            left = gap_text(float(last["explainable_gap"])).replace(" VAF", "")
            yield left, "left to explain", "as far as these runs show"
        else:
            yield "not known", "noise ceiling", search.ceiling_note_ or "of held-out rows"
    elif comparison is not None:
        yield f"{comparison.vaf:.1f} %", "VAF", f"free run, on {rows}"
        if np.isfinite(comparison.noise_ceiling):
            top = "what a model could reach, judged by what this one leaves"
            yield ceiling_text(comparison.noise_ceiling), "noise ceiling", top


def _facts_now(results: Results) -> Iterator[tuple[str, str, str]]:
    """Figures of the present model of a workbench, beside those of its search."""
    for one in results.models[:1]:
        train, hold = (_percent(one["vaf"][rows]) for rows in ("train", "hold"))
        if results.search is not None:
            yield f"{train} %", "VAF of the present model", f"{one['title']}; runs fitted"
        if hold != DASH:
            yield f"{hold} %", "VAF of the present model, held out", results.held_out


def _data(
    X: Any,
    y: Any,
    frame: pd.DataFrame,
    output: pd.Series,
    units: dict[str, str],
    baseline: Any,
    layout: RunLayout,
    comparison: Comparison | None,
    after: Comparison | None,
    gallery: Gallery,
) -> dict[str, Any]:
    model = taken_apart(baseline)[1]
    told = as_fitted(model)
    roles = roles_of(list(frame.columns), getattr(told, "roles", None))
    inputs = {str(name) for name in getattr(model, "inputs_", [])}
    channels = []
    for name, column in [*frame.items(), (output.name, output)]:
        values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)
        known = values[np.isfinite(values)]
        channels.append(
            [
                str(name),
                "output" if column is output else "input" if str(name) in inputs else "",
                "" if column is output else roles[name],
                units.get(str(name), ""),
                number(_mean(known)) if known.size else DASH,
                number(float(np.sqrt(np.mean(known**2)))) if known.size else DASH,
                f"{known.min():.4g} to {known.max():.4g}" if known.size else DASH,
                str(values.size - known.size),
            ]
        )
    of_channels = ["name", "use", "role", "unit", "mean", "rms", "range", "missing rows"]
    edges = layout.run_starts
    compared = [comparison] if after is None else [comparison, after]
    runs = [
        [
            run_name(label),
            str(edges[i + 1] - edges[i]),
            f"{(edges[i + 1] - edges[i]) * layout.dt:.4g}",
            *(_vaf_of_run(found, i) for found in compared),
        ]
        for i, label in enumerate(layout.labels[:MANY])
    ]
    of_runs = ["run", "rows", "seconds", "VAF, %"]
    if after is not None:
        of_runs[3:] = ["VAF before, %", "VAF with the effects, %"]
    n_runs = len(layout.labels)
    return {
        "sentence": f"{counted(n_runs, 'run')}, {layout.n_rows} rows at "
        f"{1 / layout.dt:.6g} Hz, {layout.n_rows * layout.dt:.4g} s in all",
        "channels": TextTable("Channels", of_channels, channels, left=of_channels[:4]),
        "runs": TextTable("Runs", of_runs, runs, left=["run"]),
        "more_runs": counted(n_runs - MANY, "more run") if n_runs > MANY else "",
        "findings": check_channels(
            X, y, dt=getattr(told, "dt", None), run=getattr(told, "run", None)
        ),
        "pictures": _traces(X, y, gallery, int(edges[1])),
    }


def _mean(values: np.ndarray) -> float:
    """The mean, or zero where it is but rounding."""
    mean = float(values.mean())
    return mean if abs(mean) > 1e-12 * np.abs(values).max() else 0.0


def _vaf_of_run(found: Comparison | None, position: int) -> str:
    if found is None:
        return DASH
    table = found.by_run[found.by_run["data"] == "validation"]
    return _fixed(table["vaf"].iloc[position], ".1f") if position < len(table) else DASH


def _traces(X: Any, y: Any, gallery: Gallery, n_first: int) -> list[Plot]:
    """The channels of the first run."""
    if not (isinstance(X, pd.DataFrame) and isinstance(y, pd.Series)):
        return []
    if not isinstance(X.index, pd.MultiIndex):
        return []
    return gallery.channels(X.iloc[:n_first, :DRAWN], y.iloc[:n_first])


def _model(baseline: Any) -> dict[str, str]:
    steps, model = taken_apart(baseline)
    lines = (inspect.getdoc(type(model)) or "").splitlines()
    return {
        "name": type(model).__name__,
        "what": lines[0] if lines else "",
        "steps": ", ".join(type(step).__name__ for step in steps),
        "text": repr(baseline),
    }


def _steps(search: EffectSearchCV, gallery: Gallery) -> list[dict[str, Any]]:
    """The baseline, and one step for each effect added."""
    path = search.error_path_
    plots = gallery.steps(search)
    worst = float(path["rmse"].max())
    last = path.iloc[-1]
    floor = np.nan  # error that the noise ceiling leaves
    if np.isfinite(last["ceiling"]) and last["vaf"] < 100:
        floor = last["rmse"] * np.sqrt(max(100 - last["ceiling"], 0.0) / (100 - last["vaf"]))
    result, steps = search.result_, []
    for step, (_, row) in enumerate(path.iterrows()):
        steps.append(
            {
                "name": with_effects(path["effect"].iloc[1 : step + 1]),
                "vaf": f"{row['vaf']:.1f}",
                "rmse": number(row["rmse"]),
                "height": f"{100 * row['rmse'] / worst:.1f}" if worst > 0 else "0",
                "floor": f"{100 * floor / worst:.1f}" if np.isfinite(floor) and worst > 0 else "",
                "told": (tell_step(result, step) if step else tell_baseline(result)).text,
                "picture": plots[step] if step < len(plots) else None,
            }
        )
    return steps


def _shape(shape: Shape | None, gallery: Gallery) -> dict[str, Any] | None:
    """What is known of an effect without a name: sentences, its curve, the nearest names."""
    if shape is None:
        return None
    curve, *nearest = shape.tables()
    return {
        "first": as_sentence(shape.explains),
        "others": shape.recordings,
        "picture": gallery.shape(shape),
        "nearest": replace(nearest[0], caption=NEAREST) if nearest else None,
        "curve": replace(curve, caption=""),
    }


def _rankings(search: EffectSearchCV) -> Iterator[dict[str, Any]]:
    """The candidates of each step, with the reason why each was added or not."""
    for step, table in search.ranking_.groupby("step"):
        refused = table["status"] == Status.REFUSED
        rows = [
            [
                str(row["rank"]),
                _in_form(row),
                _why(row),
                _fixed(row["vaf_after"], ".2f"),
                _fixed(row["vaf_gain"], "+.2f"),
                _fixed(row["evidence"], ".0f"),
                str(row["judge"]),
                _fixed(100 * row["probability"], ".0f"),
                f"{as_sentence(row['words'])} {row['parameters']}".rstrip(),
            ]
            for _, row in table[~refused].iterrows()
        ]
        header = ["rank", "effect", "outcome", "VAF, %", "gain, points"]
        header += ["evidence, nats", "granted by", "probability, %", "what it is"]
        left = ["rank", "effect", "outcome", "granted by", "what it is"]
        yield {
            "step": str(step),
            "parent": _parent(search, int(step)),
            "first": TextTable("", header, rows[:BEST], left=left),
            "others": TextTable("", header, rows[BEST:], left=left),
            "marked": list(table[~refused]["status"].head(BEST) == Status.ADDED),
            "refused": [f"{_in_form(r)}: {r['reason']}" for _, r in table[refused].iterrows()],
        }


def _in_form(row: pd.Series) -> str:
    return f"{row['title']} ({row['form']})" if row["form"] else str(row["title"])


def _parent(search: EffectSearchCV, step: int) -> str:
    """What the candidates of a step are added to."""
    added = search.error_path_["effect"].iloc[1:step]
    return f"the model {with_effects(added)}" if len(added) else "the baseline"


def _why(row: pd.Series) -> str:
    """Why a candidate is ranked where it is."""
    if row["status"] != Status.ADDED:
        return as_sentence(row["reason"])
    text = "Added: all judges grant it"
    others = titles_of(row["confused_with"]) if row["confused_with"] else ""
    return f"{text}." + (f" As good on these runs: {others}." if others else "")


def _parameters(baseline: Any, final: Any) -> TextTable:
    """Parameters of the last model, with those of the baseline beside them."""
    table = parameter_frame(baseline if final is None else final)
    before = parameter_frame(baseline)
    header = ["parameter", "value", "standard error", "95 % interval", "unit", "meaning"]
    rows = []
    for name, row in table.iterrows():
        found = Estimate.of(row)
        interval = DASH if found.low == DASH else f"{found.low} to {found.high}"
        cells = [str(name), found.value, found.sd, interval, found.unit, str(row["meaning"])]
        if final is not None:
            was = Estimate.of(before.loc[name]) if name in before.index else None
            cells.insert(5, DASH if was is None else was.value + was.remark)
        rows.append(cells)
    if final is not None:
        header.insert(5, "without new effects")
    return TextTable("", header, rows, left=["parameter", "unit", "meaning"])


def _models(models: Sequence[Mapping[str, Any]]) -> TextTable:
    """VAF and parameters of models, each a column."""
    known = [{one["name"]: one for one in model["parameters"]} for model in models]
    units = {name: one["unit"] for of_model in known for name, one in of_model.items()}
    names = [f"{model['id'] or 'this model'}: {model['title']}" for model in models]
    rows = [
        [f"VAF, {words}", *(_percent(model["vaf"][rows]) for model in models), "%"]
        for rows, words in (("train", "runs fitted"), ("hold", "runs held out"))
        if models[0]["vaf"][rows] is not None
    ]
    if any(model["other_runs"] for model in models):
        rows.append(
            ["fitted to", *("other runs" if m["other_runs"] else "these" for m in models), ""]
        )
    rows += [
        [name, *(number(of[name]["value"]) if name in of else DASH for of in known), unit]
        for name, unit in units.items()
    ]
    return TextTable("", ["figure", *names, "unit"], rows, left=["figure", "unit"])


def _percent(vaf: float | None) -> str:
    return DASH if vaf is None else f"{vaf:.1f}"


def parameter_frame(model: Any) -> pd.DataFrame:
    """Value, sd, low, high, unit and meaning of each parameter; empty where a model has none."""
    nothing = pd.DataFrame(columns=["value", "sd", "low", "high", "unit", "meaning"])
    return getattr(taken_apart(model)[1], "parameters_", nothing)


def _paths(baseline: Any, gallery: Gallery) -> list[Plot]:
    model = taken_apart(baseline)[1]
    return gallery.paths(model) if hasattr(model, "coef_path_") else []


def _go_on(results: Results, added: list[str]) -> Step:
    """How one goes on with the model that was found."""
    typed = "skhoid diagnose --save model.joblib keeps it, for skhoid compare."
    ids = [name.split("-")[0] for name in added]
    if not set(catalogue().index) >= set(ids):  # effects of the user's own
        return Step("It is search.best_estimator_.", typed)
    calls = "".join(f'.with_effect("{name}")' for name in ids)
    model = f"{type(results.baseline).__name__}(...){calls}"
    return Step(f"It is search.best_estimator_, or by hand: {model}.fit(X, y).", typed)


def _next_steps(results: Results, say: Say) -> Iterator[dict[str, str]]:
    """What to do next, the most important first."""
    search = results.search
    if search is None:
        yield advise("Which effects are missing has not been asked", results.no_search)
    else:
        added = [str(name) for name in search.error_path_["effect"].iloc[1:]]
        if added and not search.stand_ins_:
            yield advise(f"Go on with the model {with_effects(added)}", say(_go_on(results, added)))
        shape = search.shape_
        recordings = [] if shape is None else shape.recordings
        for sentence in (*search.experiments_, *recordings):
            yield advise("Record what tells effects apart", sentence)
        if shape is not None and search.verdict_ not in HOW_TO_GO_ON:  # which may name it
            why = "{} writes a file with its curve, and with a short formula where one fits."
            sketch = Step(why.format(BY_HAND), why.format("skhoid diagnose --sketch my_effect.py"))
            yield advise("Make the shape an effect of your own", say(sketch))
        if search.verdict_.leaves_unknown:
            channel = "Record the channel that carries it, or"
            own = Step(
                f"{channel} write an effect of your own and add it to effects=[...].",
                f"{channel} write an effect of your own in Python.",
            )
            how = say(HOW_TO_GO_ON.get(search.verdict_, own))
            what = f"Look at what {unexplained_by(search.result_)}"
            yield advise(what, f"{as_sentence(_unexplained(search))} {how}")
        for note in search.notes_:
            yield advise("Note", say(note))
    found = results.comparison if results.after is None else results.after
    everything = search is not None and search.tries_all
    for finding in found.findings if found is not None else []:
        if not (everything and finding.name in ANSWERED):
            yield advise(say(finding.next_step), f"{finding.title}. {finding.evidence}")
