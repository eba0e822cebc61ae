"""What a search found, told: the one place that makes words of a ``SearchResult``.

Summaries, notebooks, the command line and reports render what is told here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..effects.base import Effect
from ..effects.catalogue import BY_NAME
from ..effects.registry import title_of, titles_of
from ..model.parameters import parameter_text
from ..text import (
    DASH,
    VAF_RULE,
    Block,
    Document,
    Estimate,
    Item,
    Items,
    Note,
    Notes,
    Paragraph,
    Step,
    TextTable,
    ceiling_text,
    counted,
    estimates_table,
    gap_text,
    p_text,
    quantity,
)
from .judging import THRESHOLD
from .likeness import experiment_between
from .path import Path
from .probability import alike, runs_to_decide
from .results import SearchResult, with_effects
from .statuses import TRIED, UNKNOWN, Reason, Status, Verdict

HOW_TO_GO_ON = {
    Verdict.NOT_TRIED: Step(
        'Try the rest of the catalogue too: effects="all", which is the default.',
        "Try the rest of the catalogue too: leave out --effects.",
    ),
    Verdict.CUT_SHORT: Step(
        "Let the search add more effects: set a larger max_effects.",
        "Let the search add more effects: a larger --max-effects.",
    ),
    Verdict.TOO_LITTLE: (
        "A held-out VAF below half of the noise ceiling or, where that is not known, below 5 % "
        "says nothing of effects: five numbers fitted to 100 independent rows explain as much by "
        "chance. First look for what the output follows: other inputs, a delay, lost "
        "synchronisation, runs that do not belong together."
    ),
}
LONGER = Step(
    "Let the search take longer: set a larger time_limit.",
    "Let the search take longer: a larger --time-limit.",
)
ALLOWED_SHOWN = 6  # rows of limits in a summary
IF_SHOWN = {"at most": "from", "at least": "up to"}
P_OF_CHANGE = 0.005  # of a parameter that changes too: two are tested, which makes 0.01 for both
NO_FORM = "No free form explains it at any place either"


def tell_search(found: SearchResult) -> Document:
    """The whole search: verdict, steps, what is left, and what to record next."""
    notes = [*(Note("experiment", text) for text in found.experiments), *found.notes]
    blocks = [
        tell_baseline(found),
        *(tell_step(found, step) for step in range(1, len(found.added) + 1)),
        *tell_end(found),
        *([] if (limits := limits_table(found, ALLOWED_SHOWN)) is None else [limits]),
        Paragraph(
            f"{VAF_RULE} The points required of an effect are about the mean. ± is one "
            "standard error."
        ),
        *([Notes(notes)] if notes else []),
    ]
    return Document(tell_headline(found), blocks)


def tell_briefly(found: SearchResult) -> Document:
    """The verdict in one sentence, and the parameters of the best model."""
    return Document(tell_headline(found), [estimates_table(found.parameters)])


def tell_verdict(found: SearchResult, added: bool = False) -> str:
    """What is missing, without figures and without a full stop.

    Of a model to which what is named was ``added``, what was found and what is missing yet.
    """
    named = [name for name in found.best_effects if name != UNKNOWN]
    unknown = found.verdict.leaves_unknown
    if found.verdict is Verdict.NOTHING:
        early = " before the time limit" if found.ended_early else ""
        return f"Nothing found{early}{tell_shown(found)}"
    if found.verdict is Verdict.TOO_LITTLE:
        return "The model explains too little to say what it is missing"
    names = tell_names(found, named) if named else ""
    head = f"Found and added: {names}. " if named and added else ""
    beside = f" {names}, and" if named and not added else ""
    if found.verdict is Verdict.POSSIBLE:
        return f"{head}Missing:{beside} possibly {tell_names(found, found.stand_ins)}"
    if not unknown:
        return head[:-2] or f"Missing: {names}"
    if beside:
        return f"Missing:{beside} something that {unexplained_by(found)}"
    return f"{head}Something is missing that {unexplained_by(found)}"


def tell_headline(found: SearchResult) -> str:
    """The verdict in one sentence to quote, with the figures."""
    text = tell_verdict(found)
    first, last = found.error_path.iloc[0], found.error_path.iloc[-1]
    top = f"noise ceiling {ceiling_text(last['ceiling'])}" if np.isfinite(last["ceiling"]) else ""
    if not found.added:
        return f"{text}: held-out VAF {last['vaf']:.1f} %{top and f', {top}'}."
    shown = "them" if len(found.added) > 1 else "it"
    if found.stand_ins or found.verdict.leaves_unknown:
        shown = titles_of(found.added)
    return (
        f"{text}; with {shown} the held-out VAF rises from {first['vaf']:.1f} to "
        f"{last['vaf']:.1f} %{top and f' ({top})'}."
    )


def tell_names(found: SearchResult, names: Sequence[str]) -> str:
    """Titles of effects, each with its equals and the probability that one of these is right."""
    added = found.ranking[found.ranking["status"] == Status.ADDED]
    told = {name: title_of(name) for name in names}
    for _, row in added[added["effect"].isin(names)].iterrows():
        *equals, other = map(title_of, [row["effect"], *list_equals(found.ranking, row)])
        either = f"{', '.join(equals)} or {other}" if equals else other
        chance = f" ({100 * p:.0f} %)" if np.isfinite(p := row["probability"]) else ""
        told[row["effect"]] = either + chance
    *others, last = told.values()
    return f"{', '.join(others)} and {last}" if others else last


def list_equals(ranking: pd.DataFrame, added: pd.Series) -> list[str]:
    """What has as much evidence as an added effect, of what is easily taken for it."""
    tried = ranking[(ranking["step"] == added["step"]) & (ranking["evidence"] > THRESHOLD)]
    near = tried[(tried["evidence"] - added["evidence"]).abs() <= THRESHOLD]
    own = BY_NAME.get(added["effect"])
    known = [(name, BY_NAME.get(name)) for name in near["effect"] if name != added["effect"]]
    return [name for name, one in known if own and one and alike(own, one)]


def tell_baseline(found: SearchResult) -> Paragraph:
    """How good the model without effects is, and how good any could be."""
    first = found.error_path.iloc[0]
    top = (
        f", noise ceiling {ceiling_text(first['ceiling'])}" if np.isfinite(first["ceiling"]) else ""
    )
    text = f"Baseline: VAF {first['vaf']:.1f} % on held-out rows{top}{tell_in_loop(first)}."
    if found.ceiling_note:
        text += f" The noise ceiling is not known: {found.ceiling_note.rstrip('.')}."
    return Paragraph(text)


def tell_step(found: SearchResult, step: int) -> Paragraph:
    """What the effect added in a step does to the error, and what it means."""
    before, row = found.error_path.iloc[step - 1], found.error_path.iloc[step]
    name = str(row["effect"])
    ranking = found.ranking
    added = ranking[(ranking["status"] == Status.ADDED) & (ranking["effect"] == name)]
    text = (
        f"Step {step}, {with_effects(found.added[:step])}: VAF {before['vaf']:.1f} -> "
        f"{row['vaf']:.1f} %, RMSE {before['rmse']:.4g} -> {row['rmse']:.4g}"
        f"{tell_in_loop(before, row)}."
    )
    physics = added["words"].iloc[0] if len(added) else title_of(name)
    numbers = parameter_text(found.parameters, name)
    text += f" {physics.rstrip('.')} ({name}{f': {numbers}' if numbers else ''})."
    others = list(added["confused_with"].iloc[0]) if len(added) else []
    return Paragraph(f"{text} As good here: {titles_of(others)}." if others else text)


def tell_candidates(found: SearchResult, step: int, n: int) -> list[Block]:
    """The best n candidates of a step as a table, and the first one's reason if none was added."""
    candidates = found.ranking[found.ranking["step"] == step]
    # Without noise, which is looked for in what is left: no judge weighs it.
    tried = candidates[candidates["status"].isin(TRIED) & candidates["delta_bic"].notna()]
    n_refused = int((candidates["status"] == Status.REFUSED).sum())
    aside = f" ({n_refused} {'does' if n_refused == 1 else 'do'} not apply)" if n_refused else ""
    head = f"Search, step {step}: {counted(len(tried), 'effect')} tried{aside}, judged on "
    head += "held-out rows"
    blocks: list[Block] = [Paragraph(head)]
    if len(tried):
        blocks = [candidates_table(tried.head(n), head)]
    if step == 1 and len(tried):
        noise = titles_of([name for name, kind in BY_NAME.items() if kind.noise])
        text = (
            "gain: points of VAF on held-out rows. evidence: the least that any judge grants, in "
            f"nats, by which the search ranks; from {THRESHOLD:g} on an effect is added. "
            f"Noise ({noise}) is not counted: it is looked for in what is left."
        )
        blocks.append(Paragraph(text))
    if len(tried) and not (candidates["status"] == Status.ADDED).any():
        best = tried.iloc[0]
        none = "No effect is added"
        if found.added:
            none = f"No effect of step {step} is in the final model"
        text = f"{none}. {title_of(best['effect'])}: {best['reason']}"
        blocks.append(Paragraph(text))
    return blocks


def tell_end(found: SearchResult) -> list[Block]:
    """What is left, whether it has a shape, and how to go on."""
    blocks: list[Block] = []
    if found.verdict is Verdict.NOTHING:
        # The last step decides: the first one has a delay that was given, and is only a claim.
        last = found.tried[found.tried["step"] == found.ranking["step"].max()]
        near = last[last["status"] == Status.NOT_BETTER]
        for _, best in near.head(1).iterrows():
            text = (
                f"Best of {counted(len(near), 'effect')} tried: {title_of(best['effect'])}, "
                f"{best['vaf_gain']:+.2f} points ({p_text(best['p_value'])}). Not added: "
                f"{best['reason']}."
            )
            blocks.append(Paragraph(text))
    if found.stand_ins and found.verdict is not Verdict.POSSIBLE:
        blocks.append(Paragraph(f"{tell_stand_ins(found.stand_ins)}."))
    if found.verdict.leaves_unknown and len(found.unexplained):
        left = [
            Item(f"{row['description']} ({row['where']}): {row['points']:.1f} points")
            for _, row in found.unexplained.iterrows()
        ]
        blocks += [Paragraph(f"What {unexplained_by(found)}:"), Items(left, numbered=False)]
    texts = tell_no_name(found)
    if found.verdict in HOW_TO_GO_ON:
        texts.append(LONGER if found.ended_early else HOW_TO_GO_ON[found.verdict])
    if found.added:
        texts.append(f"{tell_closed(found)}.")
    last = found.error_path.iloc[-1]
    if np.isfinite(last["explainable_gap"]) and np.isfinite(last["ceiling"]):
        gap = gap_text(last["explainable_gap"])
        texts.append(
            f"Left to explain: {gap}, as far as these runs show; the rest looks like remnant."
        )
    return [*blocks, *map(Paragraph, texts)]


def tell_shown(found: SearchResult) -> str:
    """What these runs would have shown, as a second half of a sentence."""
    points = found.limits["shown_points"].dropna()
    if not len(points):
        return ""
    least, most = f"{points.min():.2g}", f"{points.max():.2g}"
    worth = least if least == most else f"{least} to {most}"
    of = f"{len(points)} of {counted(len(found.limits), 'effect')}"
    return f"; these runs would have shown {of} from {worth} points on"


def tell_limit(row: pd.Series, key: str) -> str:
    """How large an effect may be (``"limit"``), or is where it shows (``"shown_from"``)."""
    if not np.isfinite(row[key]):
        return DASH
    size = quantity(float(f"{row[key]:.2g}"), None if row["unit"] == "-" else row["unit"])
    words = row["sense"] if key == "limit" else IF_SHOWN[row["sense"]]
    return f"{words} {size} ({row[key.replace('_from', '') + '_points']:.2g} points)"


def limits_table(found: SearchResult, n: int | None = None) -> TextTable | None:
    """How large effects may be that are not named, those first that may be worth most, or None."""
    known = found.limits.dropna(subset=["limit"])
    if found.verdict is Verdict.TOO_LITTLE or known.empty:
        return None

    rows = [
        [
            f"{row['title']}: {row['parameter']}",
            tell_limit(row, "limit"),
            tell_limit(row, "shown_from"),
        ]
        for _, row in known.head(len(known) if n is None else n).iterrows()
    ]
    most = f", the {len(rows)} that may be worth most" if len(known) > len(rows) else ""
    caption = f"Effects that are not named: how large these runs allow them to be{most}"
    headings = ["effect", "allowed (95 %)", "would show (90 %)"]
    return TextTable(caption, headings, rows, tuple(headings), "limits")


def tell_closed(found: SearchResult) -> str:
    """What share of the gap the effects added close."""
    verb = "closes" if len(found.added) == 1 else "close"
    titles = titles_of(found.added)
    return f"{titles[0].upper()}{titles[1:]} {verb} {found.closed}"


def unexplained_by(found: SearchResult) -> str:
    """Which effects do not explain what is left, as the end of "what ..."."""
    if found.verdict is Verdict.CUT_SHORT:
        return f"is not explained within max_effects={found.max_effects}"
    if found.verdict is not Verdict.NOT_TRIED:
        return "no effect of the catalogue explains"
    n_tried = int((found.tried["step"] == 1).sum())
    if n_tried == 0:
        return "no effect was tried to explain"
    if n_tried == 1:
        return "the only effect tried does not explain"
    return f"none of the {n_tried} effects tried explains"


def tell_stand_ins(ids: Sequence[str]) -> str:
    """Which effects explain part of what is missing, but too little to name it."""
    return f"Part of it looks like {titles_of(ids)}, but too little to name it"


def tell_no_name(found: SearchResult) -> list[str]:
    """What the shape of what has no name is, or that there is none."""
    if not found.verdict.leaves_unknown or found.verdict is Verdict.POSSIBLE:
        return []
    return [f"{NO_FORM}."] if found.shape is None else found.shape.sentences()


def tell_in_loop(*rows: pd.Series) -> str:
    """VAF in the closed loop of rows of an error path, where all of them are known."""
    figures = [row["vaf_loop"] for row in rows]
    if not np.isfinite(figures).all():
        return ""
    return f"; in the closed loop VAF {' -> '.join(f'{figure:.1f}' for figure in figures)} %"


def experiments_for(ranking: pd.DataFrame) -> list[str]:
    """What to record to tell the effects added from those that explain as much."""
    return [
        experiment_between(row["effect"], other)
        for _, row in ranking[ranking["status"] == Status.ADDED].iterrows()
        for other in row["confused_with"]
    ]


def note_changes(changes: dict[str, tuple[float, float, float]]) -> list[Note]:
    """Which neuromuscular parameters change with the gains."""
    notes = []
    for name, (value, sd, p) in changes.items():
        verb = "changes too" if p < P_OF_CHANGE else "does not change"
        text = f"{name} {verb}: by {100 * value:.0f} ± {100 * sd:.0f} % ({p_text(p)})"
        notes.append(Note("changes", text))
    return notes


def note_more_runs(path: Path, names: Sequence[str], n_runs: int, confidence: float) -> list[Note]:
    """How many more runs like these would make possible names probable enough, if they are."""
    notes = []
    for step in path.steps:
        for i, one in enumerate(c for c in step.candidates if c.evidence):
            if one.effect.name not in names or not one.passes:
                continue
            more = runs_to_decide(step.tried, i, n_runs, confidence)
            runs = (
                "more runs alone would not decide"
                if more is None
                else (f"about {counted(more, 'more run')} like these would decide")
            )
            chance = f"{100 * one.probability:.0f} %"
            text = f"{title_of(one.effect.name)} is possible ({chance})"
            notes.append(Note("possible", f"{text}: {runs}"))
    return notes


def note_untried(candidates: Sequence[Effect], ranking: pd.DataFrame) -> list[Note]:
    """Why a search tried nothing, if it did: of each effect, what it needs."""
    if (ranking["status"] != Status.REFUSED).any():
        return []
    reasons = dict(zip(ranking["effect"], ranking["reason"], strict=True))
    noise = "it is noise, which no input explains, and it did not show in the residual"
    return [
        Note("untried", f"{title_of(e.name)} was not tried in the model: {noise}")
        if e.noise
        else Note(
            "untried",
            f"{title_of(e.name)} was not tried: {reasons.get(e.name, 'it does not apply')}",
        )
        for e in candidates
    ]


def note_left_out(ranking: pd.DataFrame, limit: float | None) -> list[Note]:
    """Which effects were not tried, as time was over, and which could not be fitted."""
    notes, last = [], ranking[ranking["step"] == ranking["step"].max()]
    late = last[last["reason_code"] == Reason.TIME]
    if len(late):
        beside = titles_of(next(iter(late["beside"]))) if late["beside"].iloc[0] else ""
        text = f"the time limit of {limit:g} s was reached. Not tried"
        text += f" beside {beside}" if beside else ""
        text += f": {titles_of(late['effect'])}. What has no name was not looked for"
        notes.append(
            Note("time limit", text, "time_limit=None tries all", [("time_limit", "SECONDS")])
        )
    for _, row in ranking[ranking["status"] == Status.NOT_FITTED].iterrows():
        text = f"{title_of(row['effect'])} was not judged: {row['reason']}"
        notes.append(Note("not fitted", text))
    return notes


def candidates_table(candidates: pd.DataFrame, caption: str) -> TextTable:
    """The best candidates of a step: what each gains, how likely it is, and its numbers."""
    cells: dict[str, list[str]] = {
        "effect": [f"{row['rank']}. {_in_form(row)}" for _, row in candidates.iterrows()],
        "gain": [f"{gain:+.2f}" for gain in candidates["vaf_gain"]],
        "evidence": [f"{nats:.0f}" for nats in candidates["evidence"]],
        "by": candidates["judge"].tolist(),
    }
    cells["its numbers"] = [text or "" for text in candidates["parameters"]]
    rows = list(zip(*cells.values(), strict=True))
    return TextTable(caption, list(cells), rows, ("effect", "by", "its numbers"), "candidates")


def short_ranking(ranking: pd.DataFrame, n: int, step: int | None) -> pd.DataFrame:
    """The best n candidates of each step (or of one) as texts."""
    tried = ranking[ranking["status"].isin(TRIED)]
    if step is not None:
        steps = ranking["step"].unique()
        if step not in steps:
            known = ", ".join(map(str, steps))
            raise ValueError(f"There is no step {step!r}; the steps are {known}.")
        tried = tried[tried["step"] == step]
    best = tried.groupby("step").head(n)
    return pd.DataFrame(
        {
            "effect": [_in_form(row) for _, row in best.iterrows()],
            "gain": best["vaf_gain"].map("{:+.2f}".format).tolist(),
            "evidence": [f"{x:.0f}" if np.isfinite(x) else DASH for x in best["evidence"]],
            "p": ["< 1e-6" if p < 1e-6 else f"{p:.2g}" for p in best["p_value"]],
            "outcome": best["reason"].where(best["status"] != Status.ADDED, "added").tolist(),
            "parameters": best["parameters"].tolist(),
        },
        index=pd.MultiIndex.from_arrays([best["step"], best["rank"]], names=["step", "rank"]),
    )


def _in_form(row: pd.Series) -> str:
    """An effect with the form that was tried, if it has several."""
    return title_of(row["effect"]) + (f" ({row['form']})" if row["form"] else "")


def parameters_table(
    model: Any, effects: Sequence[str] = (), truth: dict[str, float] | None = None
) -> TextTable:
    """The estimated parameters of a model, beside their true values where these are known."""
    rows = []
    for name, row in model.parameters_.iterrows():
        effect, _, own = str(name).partition("__")
        if own and row["sd"] == 0.0:  # given by the choice of a form
            continue
        found = Estimate.of(row)
        called = f"{title_of(effect)}: {own}" if own else str(name)
        true = [] if truth is None else [f"{truth[name]:.4g}" if name in truth else ""]
        error = found.sd if found.known else ""
        rows.append([called, *true, found.value, error, found.unit, found.remark.strip(" ()")])
    headings = ["parameter", *(["truth"] if truth is not None else []), "value", "±", "unit", ""]
    if not any(row[-1] for row in rows):
        headings, rows = headings[:-1], [row[:-1] for row in rows]
    of_model = f" of the model with {titles_of(effects)}" if len(effects) else ""
    caption = f"Parameters{of_model}, ± one standard error"
    return TextTable(caption, headings, rows, ("parameter", "unit", ""), "parameters")
