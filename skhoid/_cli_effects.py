"""The commands about missing effects: ``skhoid demo`` and ``skhoid diagnose``."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._cli_files import (
    add_file_options,
    as_json,
    at_least_one,
    pairs,
    read_files,
    without_screen,
)

if TYPE_CHECKING:
    from .diagnosis.story import Story

DEMO_EXAMPLES = """\
examples:
  skhoid demo                              a person with a dead zone and an offset
  skhoid demo --effect saturation --remnant 0.2 --seed 3
  skhoid demo --effect none                nothing is hidden: does it say so?
"""

DIAGNOSE_EXAMPLES = """\
examples:
  skhoid diagnose                          bundled recordings of a human tracker
  skhoid diagnose run*.csv --input e --x x --target f_t --output u --time t
  skhoid diagnose runs.mat --input data.e --output data.u --dt 0.01 --delay 0.28
  skhoid diagnose sim.csv --input e --role roll=motion --time t --effects motion_feedback bias
  skhoid diagnose stick.csv --input force --output angle --time t --core arx --na 2 --nb 2 --nk 1
"""

WIDTH = 100  # columns
BUNDLED = ["phase-size 2b", "phase-size 2c", "phase-size 2d", "phase-size 2e"]


def add_effect_commands(commands: Any) -> None:
    """Add both commands to the parser."""
    command = commands.add_parser(
        "demo",
        help="hide an effect in a simulated person, and find it",
        description="Simulate runs of a person who tracks a target, with effects hidden in them, "
        "fit a model that knows nothing of them, and find out which are missing: the whole way, "
        "with numbers at each step.",
        epilog=DEMO_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(action=demo)
    add = command.add_argument
    add(
        "--effect",
        nargs="+",
        default=["dead_zone", "bias"],
        metavar="ID",
        help="what to hide, or none (default: dead_zone bias)",
    )
    add("--runs", type=at_least_one, default=4, metavar="N", help="number of runs (default: 4)")
    add("--remnant", type=float, default=0.1, metavar="P", help="P_n (default: 0.1)")
    add("--seed", type=int, default=0, metavar="N", help="of the simulation (default: 0)")
    _add_search_options(add, "skhoid-demo")

    command = commands.add_parser(
        "diagnose",
        help="find the effects that a model of your recordings is missing",
        description="Fit a model to recorded runs, compare it with them, and find out which "
        "physical effects it is missing, on runs held out of the fit. Without files it uses four "
        "bundled recordings of a person tracking a target.",
        epilog=DIAGNOSE_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(action=diagnose)
    add = command.add_argument
    add_file_options(add)
    add("--input", default="e", metavar="NAME", help="input channel, the error (default: e)")
    add("--x", metavar="NAME", help="channel with the controlled element's output")
    add("--target", metavar="NAME", help="channel with the target f_t")
    add(
        "--role",
        action="append",
        default=[],
        metavar="NAME=ROLE",
        help="another channel: its role begins with motion or dist, or is empty; may be repeated",
    )
    add("--run-in", type=float, metavar="S", help="discard this much at the start of each run")
    add(
        "--remove-means",
        action="store_true",
        help="subtract the mean of each channel first, for positions far from zero",
    )
    add("--core", choices=["operator", "arx"], default="operator", help="default: operator")
    add("--delay", type=float, metavar="S", help="delay of the operator (default: estimated)")
    add("--na", type=int, default=2, metavar="N", help="order of the ARX core (default: 2)")
    add("--nb", type=int, default=2, metavar="N", help="order of the ARX core (default: 2)")
    add("--nk", type=int, metavar="N", help="delay of the ARX core in samples (default: found)")
    add(
        "--display",
        choices=["compensatory", "pursuit", "preview"],
        default="compensatory",
        help="what the operator could see (default: compensatory)",
    )
    add(
        "--controlled-element",
        nargs=2,
        type=float,
        metavar=("K_C", "OMEGA_B"),
        help="K_c / (s (s + omega_b)) (default: estimated where x is given)",
    )
    _add_search_options(add, "skhoid-diagnose")


def _add_search_options(add: Any, folder: str) -> None:
    add("--effects", nargs="+", metavar="ID", help="effects to try (default: all)")
    add("--max-effects", type=int, default=4, metavar="N", help="to add at most (default: 4)")
    add("--out", default=folder, metavar="FOLDER", help="folder for the pictures")
    add("--no-pictures", action="store_true", help="draw nothing")
    add("--json", action="store_true", help="print the results as JSON")
    add("--debug", action="store_true", help="show tracebacks")


def demo(options: argparse.Namespace) -> int:
    """Hide effects and find them."""
    from . import OperatorRegressor, make_tracking_runs
    from .diagnosis.story import HIDDEN
    from .effects import Effects

    names = [name for name in options.effect if name != "none"]
    unknown = [name for name in names if name not in HIDDEN]
    if unknown:
        raise ValueError(f"demo hides none, {', '.join(HIDDEN)}; got {unknown[0]!r}.")
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
    story = _tell(options, OperatorRegressor(), X, y, source, {"hidden": names, "truth_vaf": best})
    if not options.json:
        model = story.search_.best_estimator_
        _print("")
        secret = ", ".join(names) or "nothing"
        _print(f"The truth: hidden {secret}; the true answer has a VAF of {best:.1f} %")
        given = truth.parameters.iloc[0].to_dict()
        given |= {f"{n}__{p}": v for n, e in hidden for p, v in e.fixed.items()}
        for name, row in model.parameters_.iterrows():
            if name in given:
                _print(
                    f"  {name}: {given[name]:.4g}, found {row['value']:.4g} ± {row['sd']:.2g}"
                    + ("" if row["unit"] == "-" else f" {row['unit']}")
                )
    return 0


def diagnose(options: argparse.Namespace) -> int:
    """Find the effects that a model of recordings is missing."""
    if options.files:
        X, y, roles, source = _read_own(options)
    else:
        X, y, roles, source = _bundled(options)
    if options.run_in:
        from . import RunInTrimmer

        X = RunInTrimmer(run_in=options.run_in).fit_transform(X)
    if options.remove_means:
        X, y = _about_means(X), _about_means(y)
    _tell(options, _estimator(options, X, y, roles), X, y, source, {})
    return 0


def _read_own(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    roles = pairs(options.role, "--role", "NAME=ROLE, such as roll=motion")
    named = {options.input: "e", options.x: "x", options.target: "f_t"}
    roles = {**roles, **{name: role for name, role in named.items() if name}}
    X, y = read_files(options, list(roles))
    # MAT files have dotted names, of which the last part remains.
    short = {name: name if name in X else name.rpartition(".")[2] for name in roles}
    return X, y, {short[name]: role for name, role in roles.items()}, ", ".join(options.files)


def _bundled(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    from . import load_human_tracking

    X, y = load_human_tracking(BUNDLED)
    options.display, options.remove_means = "pursuit", True
    source = (
        "bundled recordings: a person follows a pseudo-random target with a mouse, four times, "
        "positions about their mean (Matic 2022, MIT licence)"
    )
    options.input = "f_t"  # the answer to the target, which is what a pursuit display shows
    return X, y, {}, source


def _about_means(data: Any) -> Any:
    """Subtract the mean of all runs, which keeps differences between runs."""
    about = data - data.mean()
    about.attrs = dict(data.attrs)
    return about


def _estimator(options: argparse.Namespace, X: Any, y: Any, roles: dict[str, str]) -> Any:
    from . import ARXRegressor, DelaySearchCV, OperatorRegressor

    error = options.input if options.input in X else options.input.rpartition(".")[2]
    shared: dict[str, Any] = {"inputs": [error], "roles": roles or None}
    if options.core == "operator":
        return OperatorRegressor(delay=options.delay, **shared)
    arx = ARXRegressor(na=options.na, nb=options.nb, nk=options.nk or 0, **shared)
    if options.nk is not None:
        return arx
    return arx.set_params(nk=DelaySearchCV(arx).fit(X, y).best_nk_)


def _tell(
    options: argparse.Namespace, estimator: Any, X: Any, y: Any, source: str, truth: dict[str, Any]
) -> Story:
    """Tell the story, as text or as JSON, and draw it."""
    from . import ControlledElement, EffectSearchCV, __version__
    from .diagnosis.story import Story

    element = getattr(options, "controlled_element", None)
    search = EffectSearchCV(
        estimator,
        effects=options.effects or "all",
        display=getattr(options, "display", "compensatory"),
        controlled_element=None if element is None else ControlledElement(*element),
        max_effects=options.max_effects,
    )
    story = Story(search, X, y)
    if not options.json:
        _print(source)
    for line in story.tell():
        if not options.json:
            _print(line)
    pictures = [] if options.no_pictures else draw(story, Path(options.out))
    if options.json:
        head = {"skhoid": __version__, "source": source, **truth}
        print(as_json({**head, **story.as_dict(), "pictures": pictures}))
    elif pictures:
        _print("")
        _print(f"Pictures: {', '.join(pictures)}")
    return story


def _print(line: str) -> None:
    """Print a line, wrapped under its indentation, at once."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    print(textwrap.fill(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False), flush=True)


def draw(story: Story, folder: Path) -> list[str]:
    """Draw what the story tells into a folder; returns the paths."""
    without_screen()
    import matplotlib.pyplot as plt

    from .plotting import (
        EffectRankingDisplay,
        EffectStepsDisplay,
        ErrorPathDisplay,
        IdentifiedEffectDisplay,
    )

    folder.mkdir(parents=True, exist_ok=True)
    search = story.search_
    figures: dict[str, Any] = {}
    if story.comparison_ is not None:
        figures["comparison.png"] = story.comparison_.plot().figure_
    for step in search.ranking_["step"].unique():
        name = f"ranking-{step}.png"
        figures[name] = EffectRankingDisplay.from_estimator(
            search, step=step, n_candidates=12
        ).figure_
    figures["error-path.png"] = ErrorPathDisplay.from_estimator(search).figure_
    figures["before-and-after.png"] = EffectStepsDisplay.from_estimator(search).figure_
    for name in search.best_estimator_.effects_.names:
        display = IdentifiedEffectDisplay.from_estimator(search, name, story.X, story.y)
        figures[f"{name}.png"] = display.figure_
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=120)
        plt.close(figure)
    return [str(folder / name) for name in figures]
