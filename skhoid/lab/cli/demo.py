"""The command ``skhoid demo``: hide effects in a simulated person, and find them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ...effects import Effects, titles_of
from ...exceptions import did_you_mean
from ...model import OperatorRegressor
from ...search.story import HIDDEN
from ...simulation import make_tracking_runs
from .files import check_folders
from .options import refuse
from .output import print_bold, print_wrapped, say_next
from .search_output import show_search, write_results
from .tables import check_tables

NEXT = [
    ("skhoid diagnose", "recordings of a real person"),
    ("skhoid simulate --remnant 0.1 --out runs.csv", "a file, as yours may be"),
    ("skhoid diagnose runs.csv", "what is missing in it?"),
]


def demo(options: argparse.Namespace) -> int:
    """Hide effects and find them."""
    names = [] if options.effect == ["none"] else options.effect
    if "none" in names:
        raise ValueError("--effect none hides nothing, and takes no other names.")
    for name in names:
        if name not in HIDDEN:
            raise ValueError(
                f"demo hides none, {', '.join(HIDDEN)}; got {name!r}.{did_you_mean(name, HIDDEN)}"
            )
    if options.no_pictures and options.no_report:
        refuse(options, ["out"], "has no use: --no-pictures and --no-report leave nothing there.")
    if options.no_pictures:
        refuse(options, ["format"], "is for the plots, and --no-pictures draws none.")
    folder = Path(options.out or "skhoid-demo")
    check_folders(folder)
    check_tables(options)
    hidden = Effects.of([HIDDEN[name] for name in names])
    X, y, truth = make_tracking_runs(
        "C1",
        n_runs=options.runs,
        remnant_intensity=options.remnant,
        channels=["e", "x", "f_t"],
        sampling_rate=50.0,  # twice what the criterion looks at
        effects=hidden,
        random_state=options.seed,
        return_truth=True,
    )
    source = f"simulated runs of condition C1, remnant P_n = {options.remnant:g}"
    best = 100 * (1 - (truth.remnant**2).sum() / (y**2).sum())
    given = truth.parameters.iloc[0].to_dict()
    given |= {f"{n}__{p}": v for n, e in hidden for p, v in e.fixed.items()}
    story = show_search(options, OperatorRegressor(), X, y, source, truth=given)
    if not options.json:
        _reveal(story.search_, names, best)
    write_results(
        options,
        story,
        source,
        report=None if options.no_report else folder / "report.html",
        folder=None if options.no_pictures else folder,
        head={"hidden": names, "truth_vaf": best},
    )
    if not options.json:
        say_next(NEXT)
    return 0


def _reveal(search: Any, names: list[str], best: float) -> None:
    """What was hidden, beside what was found."""
    print_wrapped("")
    found = search.best_effects_
    print_bold(f"The truth: hidden {titles_of(names) if names else 'nothing'}")
    same = "as found" if set(found) == set(names) else f"found: {titles_of(found)}"
    print_wrapped(f"  {same}; simulated with the true parameters the VAF is {best:.1f} %")
