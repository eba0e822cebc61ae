"""The summary of a comparison as text and as HTML."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..text import VAF_RULE, Summary, gap_text, rendered, vaf_name

if TYPE_CHECKING:
    from .comparison import Comparison

MOST_RUNS = 12  # listed


def summary(c: Comparison) -> Summary:
    lines = [f"{c.model_name} against measured {c.output}", ""]
    lines += [f"{name:<22} {value}" for name, value in figures(c)]
    lines += ["", *_runs(c), ""]
    lines += ["Findings" if c.findings else "No findings"]
    for number, finding in enumerate(c.findings, 1):
        lines += [
            f"{number}. {line}" if i == 0 else f"   {line}"
            for i, line in enumerate(str(finding).splitlines())
        ]
    lines += [
        "",
        f"{VAF_RULE} Intervals are 95 %.",
        f"With nothing missing, each test raises a false alarm in {100 * c.false_alarm:g} % of "
        "cases, and so do all findings together.",
        "Costs overlap, and later findings may follow from earlier ones: correct the first, and "
        "compare again.",
    ]
    lines += [f"Note: {note.with_hint}." for note in c.notes]
    return Summary("\n".join(lines))


def figures(c: Comparison) -> list[tuple[str, str]]:
    """The figures of a comparison, with what they are called."""
    unit = f" {c.unit}" if c.unit else ""
    ahead = "not available" if np.isnan(c.one_step_vaf) else f"{c.one_step_vaf:.1f} %"
    about = " (about the mean)" if c.mean_dominates else ""
    if np.isnan(c.noise_ceiling):
        ceiling, gap = c.ceiling_note, "not known"
    else:
        top, low, high = (
            c.about_mean(value) for value in (c.noise_ceiling, *c.noise_ceiling_interval)
        )
        ceiling = f"{top:.1f} %{about} ({low:.1f} to {high:.1f} %), {c.ceiling_note}"
        gap = gap_text(c.point_scale * c.explainable_gap)
        gap += about if gap[0].isdigit() else ""
    if c.overfit is None:
        overfit = "not available (give estimation=(X, y))"
    else:
        overfit = (
            f"{'yes' if c.overfit else 'no'}: squared error {c.overfit_ratio:.2f} times that on "
            f"estimation runs (limit 1.1), VAF there {c.estimation_vaf:.1f} %"
        )
    of_mean = f" ({100 * c.mean_share:.0f} % of the power is the mean)"
    beside = [(vaf_name(centered=True), f"{c.vaf_about_mean:.1f} %")] if about else []
    leak = [] if c.leak is None else [("Leak test", c.leak.reason)]
    return [
        ("VAF, free run", f"{c.vaf:.1f} %{of_mean if about else ''}"),
        *beside,
        ("VAF, one step ahead", ahead),
        ("RMSE, free run", f"{c.rmse:.4g}{unit}"),
        ("Noise ceiling", ceiling),
        ("Left to explain", gap),
        ("Overfit", overfit),
        *leak,
    ]


def _runs(c: Comparison) -> list[str]:
    table = c.by_run[["data", "run", "vaf", "one_step_vaf", "rmse", "ratio", "exceeds"]]
    title = "Runs"
    if len(table) > MOST_RUNS:
        title = f"Runs, the {MOST_RUNS} with the lowest VAF of {len(table)}"
        table = table.sort_values("vaf", kind="stable").head(MOST_RUNS)
    return [title, table.round(3).to_string(index=False)]


def html(c: Comparison) -> str:
    runs = c.by_run.drop(columns=["target", "p"]).round(3)
    return rendered(
        __name__,
        "comparison.html.j2",
        comparison=c,
        figures=figures(c),
        runs=runs.to_html(index=False, border=0),
    )
