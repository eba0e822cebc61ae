"""The command ``skhoid simulate``: runs of a tracking task, written to a file."""

from __future__ import annotations

import argparse
import secrets
import shlex
from typing import Any

import skhoid

from .files import check_plot_file, new_file, without_screen
from .output import print_json, print_wrapped
from .parser import add_command, add_output_options, at_least_one, not_negative, positive, seed

ABOUT = """\
simulate runs of a tracking task and write them to a file
Simulate a human operator in the closed loop of the thesis, with remnant, and write the runs to a
file that `skhoid identify` reads."""
EXAMPLES = """\
examples:
  skhoid simulate --condition C4 --runs 5 --remnant 0.15 --out runs.parquet
  skhoid diagnose runs.parquet
  skhoid simulate --condition C1 --remnant 0.2 --effect dead_zone --out c1.mat
"""


def add_simulate(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, simulate, ABOUT, "--out FILE [OPTIONS]", EXAMPLES)
    add = command.section("Data")
    add("--condition", default="C1", metavar="C", help="C1 to C6 (Table III; default: C1)")
    add("--runs", type=at_least_one, default=5, metavar="N", help="number of runs (default: 5)")
    text = "P_n, such as 0.15 (default: 0)"
    add("--remnant", type=not_negative, default=0.0, metavar="P", help=text)
    text = "hidden in the operator: ids of skhoid's catalogue, as large as in skhoid demo"
    add("--effect", nargs="+", default=[], metavar="ID", help=text)
    add("--rate", type=positive, default=100.0, metavar="HZ", help="sampling rate (default: 100)")
    add("--seed", type=seed, metavar="N", help="the same number gives the same runs")
    add = command.section("Output")
    add("--out", required=True, metavar="FILE", help=".csv, .tsv, .parquet or .mat")
    add("--overwrite", action="store_true", help="replace files that exist")
    add("--picture", metavar="FILE", help="draw the first run and the spread (.png, .pdf, .svg)")
    add_output_options(add, tables=False)


def hidden_effects(names: list[str]) -> Any:
    """Effects of ids, as large as they matter in simulated runs."""
    from ...effects import Effects

    return Effects.of([_hide(name) for name in names])


def _hide(name: str) -> Any:
    from ...effects import effect

    known = effect(name)
    if known.hidden:
        return known.with_choices(**known.hidden)
    why = "it responds to a column that is not simulated"
    if "human" not in known.domains:
        why = "it is for machines"
    elif known.noise:
        why = "it is noise, which no model simulates"
    raise ValueError(f"A simulated person cannot have {name}: {why}.")


def simulate(options: argparse.Namespace) -> int:
    """Simulate, write, and say what is in the file."""
    from ...io import save_figure
    from ...text import counted

    number = secrets.randbelow(2**31) if options.seed is None else options.seed
    path = new_file(options.out, options.overwrite)
    if options.picture:
        check_plot_file(options.picture, options.overwrite)
    X, y, truth = skhoid.make_tracking_runs(
        options.condition,
        options.runs,
        remnant_intensity=options.remnant,
        channels=["e", "x", "f_t"],
        sampling_rate=options.rate,
        effects=hidden_effects(options.effect) if options.effect else None,
        random_state=number,
        return_truth=True,
    )
    skhoid.write_runs(X, y, path, overwrite=options.overwrite)
    by_run = truth.remnant.groupby(level="run").var() / y.groupby(level="run").var()
    if options.picture:
        without_screen()
        display = skhoid.plotting.TrackingDisplay.from_runs(X, y, truth=truth)
        save_figure(display.figure_, options.picture)
    follow = shlex.join(["skhoid", "diagnose", str(path)])
    condition = options.condition.upper()
    if options.json:
        found = {
            "file": str(path),
            "condition": condition,
            "n_runs": options.runs,
            "n_rows": len(X),
            "dt_s": 1 / options.rate,
            "channels": [*X.columns, y.name],
            "effects": options.effect,
            "seed": number,
            "remnant": {str(label): share for label, share in by_run.items()},
            "picture": options.picture,
            "next": follow,
        }
        print_json(options, found)
        return 0
    rows = f"{len(X)} rows at {options.rate:g} Hz, seed {number}"
    print_wrapped(f"{path}: {counted(options.runs, 'run')} of {condition}, {rows}")
    if options.remnant:
        print_wrapped(
            f"remnant: P_n = {by_run.mean():.3f} on average ({by_run.min():.3f} to "
            f"{by_run.max():.3f}), wanted {options.remnant:g}"
        )
    if options.picture:
        print_wrapped(f"picture: {options.picture}")
    print(f"next: {follow}")  # not wrapped: to be copied
    return 0
