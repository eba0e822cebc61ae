"""The command ``skhoid simulate``: runs of a tracking task, written to a file."""

from __future__ import annotations

import argparse
import secrets
import shlex
import sys
from typing import Any

from ..._version import __version__
from ...io import write_runs
from ...io.figures import save_figure
from ...simulation import make_tracking_runs
from ...text import counted
from .files import check_plot_file, new_file, without_screen
from .options import refuse
from .output import print_json, say


def simulate(options: argparse.Namespace) -> int:
    """Simulate, write, and say what is in the file."""
    if options.remnant == 0:
        refuse(options, ["remnant_order", "open_loop"], "needs --remnant P: there is none.")
    order = options.remnant_order or "2"
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    path = new_file(options.out, options.overwrite)
    if options.picture:
        check_plot_file(options.picture, options.overwrite)
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
        from ...plotting import TrackingDisplay

        display: Any = TrackingDisplay.from_runs(X, y, truth=truth)
        save_figure(display.figure_, options.picture)
        say(f"picture: {options.picture}", options)
    follow = shlex.join(["skhoid", "diagnose", str(path)])
    if not options.json:
        print(f"next: {follow}")  # not wrapped: to be copied
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
