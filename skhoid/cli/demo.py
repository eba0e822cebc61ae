"""The command ``skhoid demo``: hide effects in a simulated person, and find them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .commands import add_command
from .files import check_folders
from .options import at_least_one, refuse
from .output import add_output_options, check_tables, print_wrapped
from .telling import add_picture_options, add_search_options, leave, tell

EXAMPLES = """\
examples:
  skhoid demo                              a person with a dead zone and an offset
  skhoid demo --effect saturation --remnant 0.2 --seed 3
  skhoid demo --effect none                nothing is hidden: does it say so?
"""
NEXT = """
Next: skhoid diagnose                      the same on recordings of a real person
      skhoid diagnose run*.csv --input e --x x --target f_t --output u --time t --report out.html
                                           and on your own"""


def add_demo(commands: Any) -> None:
    """Add the command to the parser."""
    from ..search.story import HIDDEN

    command = add_command(
        commands,
        "demo",
        demo,
        "hide an effect in a simulated person, and find it",
        "Simulate runs of a person who tracks a target, with effects hidden in them, "
        "fit a model that knows nothing of them, and find out which are missing: the whole way, "
        "with numbers at each step, and a report in the end.",
        EXAMPLES,
    )
    add = command.add_argument
    add(
        "--effect",
        nargs="+",
        default=["dead_zone", "bias"],
        metavar="HIDDEN",
        help=f"hidden in the person: none, or of {', '.join(HIDDEN)} (default: dead_zone bias)",
    )
    add("--runs", type=at_least_one, default=4, metavar="N", help="number of runs (default: 4)")
    add("--remnant", type=float, default=0.1, metavar="P", help="P_n (default: 0.1)")
    add("--seed", type=int, default=0, metavar="N", help="of the simulation (default: 0)")
    add_search_options(add)
    add_picture_options(add, "skhoid-demo")
    add("--no-report", action="store_true", help="do not write report.html into that folder")
    add_output_options(add)


def demo(options: argparse.Namespace) -> int:
    """Hide effects and find them."""
    from .. import OperatorRegressor, make_tracking_runs
    from ..effects import Effects
    from ..exceptions import did_you_mean
    from ..search.story import HIDDEN

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
    story = tell(options, OperatorRegressor(), X, y, source)
    if not options.json:
        _reveal(story.search_.best_estimator_, names, best, truth, hidden)
    leave(
        options,
        story,
        source,
        report=None if options.no_report else folder / "report.html",
        folder=None if options.no_pictures else folder,
        head={"hidden": names, "truth_vaf": best},
    )
    if not options.json:
        print(NEXT)
    return 0


def _reveal(model: Any, names: list[str], best: float, truth: Any, hidden: Any) -> None:
    """The truth beside what was found."""
    from ..summaries import Estimate

    print_wrapped("")
    secret = ", ".join(names) or "nothing"
    print_wrapped(f"The truth: hidden {secret}; the true answer has a VAF of {best:.1f} %")
    given = truth.parameters.iloc[0].to_dict()
    given |= {f"{n}__{p}": v for n, e in hidden for p, v in e.fixed.items()}
    for name, row in model.parameters_.iterrows():
        if name in given:
            print_wrapped(f"  {name}: {given[name]:.4g}, found {Estimate.of(row)}")
