"""The command ``skhoid simulate``: runs of a tracking task, written to a file."""

from __future__ import annotations

import argparse
import secrets
import shlex
import sys
from typing import Any

from .commands import add_command
from .files import check_picture, new_file, without_screen
from .options import at_least_one, positive, refuse
from .output import add_output_options, print_json, say

EXAMPLES = """\
examples:
  skhoid simulate --condition C4 --runs 5 --remnant 0.15 --out runs.parquet
  skhoid identify runs.parquet --input e --output u --time time --run run --keep-means
  skhoid simulate --condition C1 --remnant 0.2 --remnant-order 3 --channels e x f_t --out c1.mat
"""


def add_simulate(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "simulate",
        simulate,
        "simulate runs of a tracking task and write them to a file",
        "Simulate a human operator in the closed loop of the thesis, with remnant, and "
        "write the runs to a file that `skhoid identify` reads.",
        EXAMPLES,
    )
    add = command.add_argument
    add("--condition", default="C1", metavar="C", help="C1 to C6 (Table III; default: C1)")
    add("--runs", type=at_least_one, default=5, metavar="N", help="number of runs (default: 5)")
    add("--remnant", type=float, default=0.0, metavar="P", help="P_n, such as 0.15 (default: 0)")
    add("--remnant-order", metavar="M", help="1, 2, 3, 4 or nm (default: 2)")
    add("--channels", nargs="+", default=["e"], metavar="NAME", help="e, x, f_t, dist (default: e)")
    add("--rate", type=positive, default=100.0, metavar="HZ", help="sampling rate (default: 100)")
    add("--random-phases", action="store_true", help="new phases of the target in each run")
    add("--open-loop", action="store_true", help="remnant does not go round the loop")
    add("--seed", type=int, metavar="N", help="the same number gives the same runs")
    add("--out", required=True, metavar="FILE", help=".csv, .tsv, .parquet or .mat")
    add("--overwrite", action="store_true", help="replace files that exist")
    add("--picture", metavar="FILE", help="draw the first run, with the spread of the others")
    add_output_options(add, tables=False)


def simulate(options: argparse.Namespace) -> int:
    """Simulate, write, and say what is in the file."""
    from .. import __version__, make_tracking_runs, write_runs
    from ..summaries import counted

    if options.remnant == 0:
        refuse(options, ["remnant_order", "open_loop"], "needs --remnant P: there is none.")
    order = options.remnant_order or "2"
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    path = new_file(options.out, options.overwrite)
    if options.picture:
        check_picture(options.picture, options.overwrite)
    X, y, truth = make_tracking_runs(
        options.condition,
        options.runs,
        remnant_intensity=options.remnant,
        remnant_order=int(order) if order.isdecimal() else order,
        channels=options.channels,
        sampling_rate=options.rate,
        random_phases=options.random_phases,
        open_loop=options.open_loop,
        random_state=seed,
        return_truth=True,
        progress=sys.stdout.isatty() and not options.json,
    )
    write_runs(X, y, path, overwrite=options.overwrite)
    runs = counted(options.runs, "run")
    condition = options.condition.upper()
    say(
        f"{path}: {runs} of {condition}, {len(X)} rows at {options.rate:g} Hz, seed {seed}", options
    )
    by_run = truth.remnant.groupby(level="run").var() / y.groupby(level="run").var()
    if options.remnant:
        say(
            f"remnant: P_n = {by_run.mean():.3f} on average ({by_run.min():.3f} to "
            f"{by_run.max():.3f}), wanted {options.remnant:g}",
            options,
        )
    if options.picture:
        without_screen()
        from ..io.figures import save_figure
        from ..plotting import TrackingDisplay

        display: Any = TrackingDisplay.from_runs(X, y, truth=truth)
        save_figure(display.figure_, options.picture)
        say(f"picture: {options.picture}", options)
    words = ["skhoid", "identify", str(path)]
    words += ["--input", "e" if "e" in options.channels else options.channels[0]]
    words += ["--output", "u", "--time", "time"]
    words += [] if path.suffix.lower() == ".mat" else ["--run", "run"]
    follow = shlex.join([*words, "--keep-means"])
    say(f"next: {follow}", options)
    if options.json:
        print_json(
            {
                "skhoid": __version__,
                "file": str(path),
                "condition": condition,
                "n_runs": options.runs,
                "n_rows": len(X),
                "dt_s": 1 / options.rate,
                "channels": [*X.columns, y.name],
                "seed": seed,
                "remnant": {str(label): share for label, share in by_run.items()},
                "picture": options.picture,
                "next": follow,
            }
        )
    return 0
