"""``skhoid diagnose FILES --dry-run``: what was understood, before anything is fitted."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .files import describe_runs, save_figures, without_screen
from .output import print_document, print_json, print_source, say_files

_FIRST = 20.0  # s that the picture shows
_MOST_RUNS = 10  # in the table of runs
# Processor time (s) of one form of an effect, of one of its rows, and of the task that measures how
# fast a machine is; steps of a search in which effects are found take longer. Of eight searches of
# 2,000 to 64,000 rows.
_OF_TRIAL, _OF_ROW, _REFERENCE, _OF_FOUND = 0.086, 1.7e-6, 3.8e-3, 2.0


@contextmanager
def columns_shown(options: argparse.Namespace) -> Iterator[None]:
    """Print what the columns of the first file hold where a dry run finds that they are unclear."""
    import numpy as np

    from ...io import first_table, numbers_of
    from ...text import Document, TextTable
    from ..guessing import UnclearColumnsError

    try:
        yield
    except UnclearColumnsError:
        if options.dry_run and not options.json:
            table = first_table(options.files)
            rows = [
                [name, str(values.size), *_range(values), str(int(np.isnan(values).sum()))]
                for name, raw in zip(table.names, table.peek(), strict=True)
                for values in [numbers_of(raw)]
            ]
            header = ["column", "rows", "least", "most", "no number"]
            said = TextTable("", header, rows, left=("column",))
            print_document(Document("Columns of the first file", [said]), options)
        raise


def _range(values: Any) -> list[str]:
    import numpy as np

    there = values[np.isfinite(values)]
    return [f"{there.min():.4g}", f"{there.max():.4g}"] if there.size else ["", ""]


def show_dry_run(
    options: argparse.Namespace, X: Any, y: Any, search: Any, source: str, folder: Path | None
) -> int:
    """Print columns, clock, runs, what would be tried and for how long, and draw the beginning."""
    from sklearn.base import clone

    from ...model import simulated_model
    from ...recordings import check_channels
    from ...regression import units_of
    from ...runs import output_name, read_layout

    layout = read_layout(X)
    if options.core == "operator" and search.domain is None:
        search.set_params(domain="human")  # else person and controller are fitted, as rivals
    data = search.read_data(clone(simulated_model(search.estimator, "EffectSearchCV")), X, y)
    record, kind = data.record, data.prepared.core.kind
    effects = search.list_effects()
    refused = {e.name: lacks for e in effects if (lacks := e.refusal_in(record, kind))}
    noise = [e.name for e in effects if e.noise and e.name not in refused]
    tried = [e for e in effects if e.name not in refused and not e.noise]
    trials = sum(len(e.alternatives(record)) for e in tried)
    table = X.assign(**{output_name(y): y})
    table.attrs["units"] = {**units_of(X), **units_of(y)}
    found = {
        "signals": _list_signals(table, search.estimator, output_name(y)),
        "clock": {"dt_s": layout.dt, "jitter": layout.jitter, "n_rows": layout.n_rows},
        "runs": list(_list_runs(layout, table)),
        "findings": [finding.title for finding in check_channels(X, y)],
        "core": options.core,
        "tried": [effect.name for effect in tried],
        "looked_for_in_what_is_left": noise,
        "not_tried": refused,
        "n_trials": trials,
        "searched_runs": list(map(str, data.searched_runs)),
        "seconds": expected_seconds(trials, record.known.size, search.max_effects),
    }
    pictures = [] if folder is None else _draw(X, y, layout, folder, options)
    if options.json:
        print_json(options, {"source": source, **found, "pictures": pictures})
        return 0
    print_source(options, source)
    about = describe_runs(layout, search.estimator.inputs, y, table.attrs["units"])
    print_document(_tell(found, about), options)
    if pictures:
        print()
        say_files({"pictures": pictures})
    return 0


def _list_signals(table: Any, estimator: Any, output: str) -> dict[str, dict[str, Any]]:
    """What each channel is for, its unit, its range, and the rows in which it is missing."""
    from ...runs import role_of

    return {
        str(name): {
            "role": "output" if name == output else role_of(name, estimator.roles) or "",
            "is_input": name in estimator.inputs,
            "unit": table.attrs["units"].get(str(name), ""),
            "least": values.min(),
            "most": values.max(),
            "missing": int(values.isna().sum()),
        }
        for name, values in table.items()
    }


def _list_runs(layout: Any, table: Any) -> Any:
    for k, label in enumerate(layout.labels):
        start, stop = layout.run_starts[k : k + 2].tolist()
        inside = (layout.starts > start) & (layout.starts < stop)
        yield {
            "run": str(label),
            "n_rows": stop - start,
            "seconds": (stop - start) * layout.dt,
            "gaps": int(inside.sum()),
            "missing": int(table.iloc[start:stop].isna().any(axis=1).sum()),
        }


def expected_seconds(trials: int, n_rows: int, most_steps: int) -> tuple[float, float]:
    """Processor time (s) of a search that finds nothing, and of one that finds the most."""
    speed = _time_of_reference() / _REFERENCE
    one = speed * trials * (_OF_TRIAL + _OF_ROW * n_rows)
    return one, one * (1 + _OF_FOUND * most_steps)


def _time_of_reference() -> float:
    """Processor time (s) of a task that is always the same: the best of ten."""
    import time

    import numpy as np
    from threadpoolctl import threadpool_limits

    table = np.random.default_rng(0).standard_normal((20_000, 20))
    took = []
    with threadpool_limits(1):
        for _ in range(10):
            start = time.process_time()
            np.linalg.lstsq(table, table[:, 0])
            took.append(time.process_time() - start)
    return min(took)


def _tell(found: dict[str, Any], about: str) -> Any:
    """What was understood, as a document."""
    from ...text import Block, Document, Heading, Paragraph, TextTable, counted

    clock, runs, refused = found["clock"], found["runs"], found["not_tried"]
    signals = [
        [
            name,
            "input" if one["is_input"] and not one["role"] else one["role"] or "not used",
            one["unit"],
            f"{one['least']:.4g}",
            f"{one['most']:.4g}",
            str(one["missing"]),
        ]
        for name, one in found["signals"].items()
    ]
    header = ["channel", "role", "unit", "least", "most", "missing"]
    of_runs = [
        [
            one["run"],
            str(one["n_rows"]),
            f"{one['seconds']:.1f}",
            str(one["gaps"]),
            str(one["missing"]),
        ]
        for one in runs[:_MOST_RUNS]
    ]
    blocks: list[Block] = [
        Paragraph(about),
        Heading("Channels"),
        TextTable("", header, signals, left=("channel", "role", "unit")),
        Heading("Clock and runs"),
        Paragraph(
            f"The sampling time is {clock['dt_s']:.6g} s, and steps of the clock differ from it "
            f"by at most {100 * clock['jitter']:.1f} %."
        ),
        TextTable("", ["run", "rows", "s", "gaps", "rows with missing"], of_runs, left=("run",)),
    ]
    if len(runs) > _MOST_RUNS:
        blocks.append(Paragraph(f"and {counted(len(runs) - _MOST_RUNS, 'run')} more."))
    blocks += [Heading("What the check of the channels finds")]
    blocks += [Paragraph(title) for title in found["findings"]] or [Paragraph("Nothing.")]
    least, most = found["seconds"]
    blocks += [
        Heading("What would be tried"),
        Paragraph(
            f"{counted(len(found['tried']), 'effect')} in {counted(found['n_trials'], 'form')}, "
            f"added to {_CORES[found['core']]}: {', '.join(found['tried']) or 'none'}."
        ),
    ]
    if noise := found["looked_for_in_what_is_left"]:
        blocks.append(Paragraph(f"Looked for in what is left, as noise: {', '.join(noise)}."))
    if refused:
        blocks.append(
            Paragraph(
                f"{counted(len(refused), 'effect')} cannot be tried on these recordings: "
                f"{', '.join(refused)}."
            )
        )
    blocks.append(
        Paragraph(
            f"It would take about {_duration(least)} of processor time if nothing is found, and up "
            f"to about {_duration(most)} with the most effects that may be added. The first search "
            "on a machine compiles first."
        )
    )
    return Document("Nothing was fitted: this is what was understood", blocks)


_CORES = {"operator": "the model of an operator", "arx": "an ARX model"}


def _duration(seconds: float) -> str:
    """A time that is known by its order of magnitude."""
    if seconds < 90:
        return f"{max(1.0, seconds):.1g} s"
    return f"{seconds / 60:.1g} min" if seconds < 5400 else f"{seconds / 3600:.1g} h"


def _draw(X: Any, y: Any, layout: Any, folder: Path, options: argparse.Namespace) -> list[str]:
    """Draw the first seconds of the first run into a folder; returns the paths."""
    from ...plotting import TrackingDisplay

    without_screen()
    rows = slice(0, int(layout.run_starts[1]))
    first, output = X.iloc[rows], y.iloc[rows]
    begin = float(layout.time[0])
    display = TrackingDisplay.from_runs(first, output, window=(begin, begin + _FIRST))
    figures = {"first-seconds": display.figure_}
    return save_figures(figures, folder, options.command, options.format, named=(X, y))
