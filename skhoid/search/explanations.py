"""Sentences about a search: its summary, what effects mean, what to record to tell them apart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pandas as pd

from ..effects.base import Effect
from ..effects.registry import title_of, titles_of
from ..text import VAF_RULE, counted, gap_text, p_text
from .likeness import experiment_between
from .statuses import Status, Verdict

# What an effect on a compensatory display can only be equivalent to, and why.
SHOWS_TARGET = {"feedforward", "preview", "output_feedback"}
EQUIVALENT = (
    "equivalent to {}: a compensatory display shows only the error, and since e = f_t - x the "
    "same output follows from other lags of e; the operator cannot have seen target and x "
    "separately"
)
NOT_SAID = (
    "if the display shows the error alone (set display=), it is equivalent to other lags of e"
)
HOW_TO_GO_ON = {
    Verdict.NOT_TRIED: 'Try the rest of the catalogue too: effects="all", which is the default.',
    Verdict.CUT_SHORT: "Let the search add more effects: set a larger max_effects.",
}


def sentence_of(effect: Effect, display: str | None, domain: str = "human") -> str:
    """What an effect means, in one sentence, given what the operator could see, if there is one."""
    if domain == "machine":
        return effect.physics_in(domain)
    if effect.name in SHOWS_TARGET and display is None:
        return f"{effect.physics[:-1]}; {NOT_SAID}"
    seen = display != "compensatory" and (effect.name != "preview" or display == "preview")
    if effect.name in SHOWS_TARGET and not seen:
        if display == "pursuit":
            return (
                "equivalent to preview: a pursuit display shows the target as it is now, not what "
                "comes; a target that the operator can predict looks the same"
            )
        return EQUIVALENT.format(effect.title)
    return effect.physics_in(domain)


def changes_sentences(changes: dict[str, tuple[float, float, float]]) -> list[str]:
    """Which neuromuscular parameters change with the gains, as sentences."""
    lines = []
    for name, (value, sd, p) in changes.items():
        parameter = name.removesuffix("_change")
        # Two parameters are tested for each change: 0.005 each makes 0.01 for both.
        verb = "changes too" if p < 0.005 else "does not change"
        lines.append(f"{parameter} {verb}: by {100 * value:.0f} ± {100 * sd:.0f} % ({p_text(p)})")
    return lines


def with_effects(names: Iterable[str]) -> str:
    """What a model is called by all effects that were added to it: ``with bias and dead zone``."""
    names = list(names)
    return f"with {titles_of(names)}" if names else "baseline"


def experiments(ranking: pd.DataFrame) -> list[str]:
    """What to record to tell the effects added from those that explain as much."""
    return [
        experiment_between(row["effect"], other)
        for _, row in ranking[ranking["status"] == Status.ADDED].iterrows()
        for other in row["confused_with"]
    ]


def unexplained_by(verdict: Verdict, ranking: pd.DataFrame, max_effects: int) -> str:
    """Which effects do not explain what is left, as the end of "what ..."."""
    if verdict is Verdict.CUT_SHORT:
        return f"is not explained within max_effects={max_effects}"
    if verdict is not Verdict.NOT_TRIED:
        return "no effect of the catalogue explains"
    n_tried = int(((ranking["step"] == 1) & (ranking["status"] != Status.REFUSED)).sum())
    if n_tried == 0:
        return "no effect was there to explain"
    if n_tried == 1:
        return "the only effect tried does not explain"
    return f"none of the {n_tried} effects tried explains"


def untried_notes(candidates: Sequence[Effect], ranking: pd.DataFrame) -> list[str]:
    """Why a search tried nothing, if it did: of each effect, what it needs."""
    if len(ranking) and (ranking["status"] != Status.REFUSED).any():
        return []
    reasons = dict(zip(ranking["effect"], ranking["reason"], strict=True))
    refused = "it does not apply"
    return [
        f"{title_of(effect.name)} was not tried in the model: it is noise, which no input "
        "explains, and it did not show in the residual"
        if effect.noise
        else f"{title_of(effect.name)} was not tried: {reasons.get(effect.name, refused)}"
        for effect in candidates
    ]


def stand_ins_sentence(ids: Sequence[str]) -> str:
    """The sentence on effects that explain part of what is missing, but too little to name it."""
    return f"Part of it looks like {titles_of(ids)}, but too little to name it"


def headline_of(
    path: pd.DataFrame, ids: Sequence[str], stand_ins: Sequence[str], verdict: Verdict, rest: str
) -> str:
    """The verdict in one sentence to quote; ``rest`` is the end of "something that ..."."""
    named = titles_of([name for name in ids if name != "unknown"])
    first, last = path.iloc[0], path.iloc[-1]
    top = f"noise ceiling {last['ceiling']:.1f} %" if np.isfinite(last["ceiling"]) else ""
    unknown = ids and ids[-1] == "unknown"
    if verdict is Verdict.NOTHING:
        text = "Nothing is missing that these data could show"
    elif list(ids) == ["unknown"]:
        text = f"Something is missing that {rest}"
    else:
        text = f"Missing: {named}" + (f", and something that {rest}" if unknown else "")
    if len(path) == 1:
        return f"{text}: held-out VAF {last['vaf']:.1f} %{top and f', {top}'}."
    added = list(path["effect"].iloc[1:])
    shown = "them" if len(added) > 1 else "it"
    if stand_ins or unknown:
        shown = titles_of(added)
    return (
        f"{text}; with {shown} the held-out VAF rises from {first['vaf']:.1f} to "
        f"{last['vaf']:.1f} %{top and f' ({top})'}."
    )


def in_loop_text(*rows: pd.Series) -> str:
    """VAF in the closed loop of rows of an error path, where all of them are known."""
    figures = [row["vaf_loop"] for row in rows]
    if not np.isfinite(figures).all():
        return ""
    return f"; in the closed loop VAF {' -> '.join(f'{figure:.1f}' for figure in figures)} %"


def summary_of(
    path: pd.DataFrame,
    ranking: pd.DataFrame,
    ids: Sequence[str],
    stand_ins: Sequence[str],
    verdict: Verdict,
    max_effects: int,
    no_ceiling: str,
    unexplained: pd.DataFrame,
    shape: Sequence[str],
    notes: Sequence[str],
) -> str:
    """The whole search in plain sentences; ``path`` has the final parameters of each effect.

    ``shape`` is what is said of the shape of what has no name.
    """
    first, last = path.iloc[0], path.iloc[-1]
    ceiling = first["ceiling"]
    rest = unexplained_by(verdict, ranking, max_effects)
    top = f", noise ceiling {ceiling:.1f} %" if np.isfinite(ceiling) else ""
    lines = [
        headline_of(path, ids, stand_ins, verdict, rest),
        "",
        f"Baseline: VAF {first['vaf']:.1f} % on held-out rows{top}{in_loop_text(first)}.",
    ]
    if no_ceiling:
        lines.append(f"  The noise ceiling is not known: {no_ceiling}.")
    lines += _steps(path, ranking)
    if verdict is Verdict.NOTHING:
        # The last step decides: the first one has a delay that was given, and is only a claim.
        last_step = ranking["step"] == ranking["step"].max()
        near = ranking[last_step & (ranking["status"] == Status.NOT_BETTER)]
        if len(near):
            best = near.iloc[0]
            lines.append(
                f"Best of {counted(len(near), 'effect')} tried: {title_of(best['effect'])}, "
                f"{best['vaf_gain']:+.2f} points ({p_text(best['p_value'])}). Not added: "
                f"{best['reason']}."
            )
    if stand_ins:
        lines.append(f"{stand_ins_sentence(stand_ins)}.")
    if ids and ids[-1] == "unknown" and len(unexplained):
        lines.append(f"What {rest}:")
        for _, row in unexplained.iterrows():
            lines.append(f"  - {row['description']} ({row['where']}): {row['points']:.1f} points")
    lines += shape
    if verdict in HOW_TO_GO_ON:
        lines.append(HOW_TO_GO_ON[verdict])
    gap = last["explainable_gap"]
    if np.isfinite(gap) and np.isfinite(ceiling):
        lines.append(f"Left to explain: {gap_text(gap)}; the rest is remnant.")
    lines.append("")
    lines.append(
        f"{VAF_RULE} The points required of an effect are about the mean. ± is one standard error."
    )
    lines += [f"Note: {note}" for note in notes]
    return "\n".join(lines)


def _steps(path: pd.DataFrame, ranking: pd.DataFrame) -> Iterator[str]:
    """What each step added, with all effects that its model has."""
    for step, row in path.iloc[1:].iterrows():
        name, before = row["effect"], path.loc[step - 1]
        added = ranking[(ranking["status"] == Status.ADDED) & (ranking["effect"] == name)]
        yield (
            f"Step {step}, {with_effects(path['effect'].iloc[1 : step + 1])}: VAF "
            f"{before['vaf']:.1f} -> {row['vaf']:.1f} %, RMSE {before['rmse']:.4g} -> "
            f"{row['rmse']:.4g}{in_loop_text(before, row)}."
        )
        physics = added["words"].iloc[0] if len(added) else title_of(name)
        parameters = f": {row['parameters']}" if row["parameters"] else ""
        yield f"  {physics.rstrip('.')} ({name}{parameters})."
        others = list(added["confused_with"].iloc[0]) if len(added) else []
        if others:
            yield f"  As good here: {titles_of(others)}."
