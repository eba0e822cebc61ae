"""A comparison told as a document, and as numbers for JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..text import (
    DASH,
    VAF_RULE,
    Document,
    Facts,
    Heading,
    Item,
    Items,
    Notes,
    Paragraph,
    TextTable,
    ceiling_text,
    gap_text,
    number,
    vaf_name,
)

if TYPE_CHECKING:
    from .comparison import Comparison

MOST_RUNS = 12  # listed
OF_RUNS = ["data", "run", "vaf", "one_step_vaf", "rmse", "ratio", "exceeds"]


def tell_comparison(c: Comparison) -> Document:
    """How good a model is, where it fails, and what to do next."""
    findings = [
        Item(f.title, {"Evidence": f.evidence, "Meaning": f.meaning, "Next": f.next_step})
        for f in c.findings
    ]
    return Document(
        f"{c.model_name} against measured {c.output}",
        [
            Facts(tell_figures(c), beside=False),
            _table_of_runs(c),
            Heading("Findings" if findings else "No findings"),
            Items(findings),
            Paragraph(f"{VAF_RULE} Intervals are 95 %."),
            Paragraph(
                f"With nothing missing, each test raises a false alarm in "
                f"{100 * c.false_alarm:g} % of cases, and so do all findings together. Costs "
                "overlap, and later findings may follow from earlier ones: correct the first, and "
                "compare again."
            ),
            Notes(c.notes),
        ],
    )


def tell_figures(c: Comparison) -> dict[str, str]:
    """The figures of a comparison, by what they are called."""
    unit = f" {c.unit}" if c.unit else ""
    about = " (about the mean)" if c.mean_dominates else ""
    of_mean = f" ({100 * c.mean_share:.0f} % of the power is the mean)" if about else ""
    told = {"VAF, free run": f"{c.vaf:.1f} %{of_mean}"}
    if np.isfinite(c.vaf_about_mean):
        told[vaf_name(centered=True)] = f"{c.vaf_about_mean:.1f} %"
        told["Fit, as of MATLAB"] = f"{c.fit:.1f} %"
    if np.isfinite(c.one_step_vaf):
        told["VAF, one step ahead"] = f"{c.one_step_vaf:.1f} %"
    told["RMSE, free run"] = f"{c.rmse:.4g}{unit}"
    told["Offset, free run"] = f"{c.offset:.4g}{unit}, the mean of the residual"
    if np.isnan(c.noise_ceiling):
        told["Noise ceiling"] = f"not known: {c.ceiling.note}"
    else:
        top = ceiling_text(c.about_mean(c.noise_ceiling))
        told["Noise ceiling"] = f"{top}{about}, {c.ceiling.note}"
        gap = gap_text(c.point_scale * c.explainable_gap)
        more = "" if c.ceiling.route.separates else "at least "
        told["Left to explain"] = more + gap + (about if gap[0].isdigit() else "")
    if c.overfit is not None:
        told["Held out"] = (
            f"{'worse' if c.overfit else 'as good'}: squared error {c.overfit_ratio:.2f} times "
            f"on estimation runs (limit 1.1), VAF there {c.estimation_vaf:.1f} %"
        )
    if c.leak is not None:
        told["Leak test"] = c.leak.reason
    return told


def _rounded(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if np.isfinite(value) else DASH


def _table_of_runs(c: Comparison) -> TextTable:
    table, title = c.by_run[OF_RUNS], "Runs"
    if len(table) > MOST_RUNS:
        title = f"Runs, the {MOST_RUNS} with the lowest VAF of {len(table)}"
        table = table.sort_values("vaf", kind="stable").head(MOST_RUNS)
    rows = [
        [
            str(row.run),
            row.data,
            _rounded(row.vaf, 1),
            _rounded(row.one_step_vaf, 1),
            number(row.rmse),
            _rounded(row.ratio, 2),
            "yes" if row.exceeds else "",
        ]
        for row in table.itertuples()
    ]
    header = ["run", "data", "VAF, %", "one step, %", "RMSE", "ratio", "beyond chance"]
    return TextTable(title, header, rows, left=("run", "data"), kind="runs")


def gather_figures(c: Comparison) -> dict[str, Any]:
    """The figures of a comparison, its leak test, findings and notes, for JSON."""
    return {
        "model": c.model_name,
        "output": c.output,
        "dt_s": c.dt,
        "domain": c.domain,
        **vars(c.figures),
        "overfit": c.overfit,
        "noise_ceiling": c.noise_ceiling,
        "noise_ceiling_interval": list(c.noise_ceiling_interval),
        "explainable_gap": c.explainable_gap,
        "ceiling_route": c.ceiling_route,
        "ceiling_status": c.ceiling.note.kind,
        "ceiling_note": c.ceiling.note.text,
        "leak": None if c.leak is None else {**vars(c.leak), "reason": c.leak.reason},
        "findings": [vars(finding) for finding in c.findings],
        "notes": list(map(str, c.notes)),
    }
