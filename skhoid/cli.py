"""The command line: thin, every capability is a function of the package."""

from __future__ import annotations

import argparse
import secrets
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import __version__
from ._cli_effects import add_effect_commands
from ._cli_files import add_file_options, as_json, at_least_one, read_files, without_screen
from ._cli_study import add_study_command
from .exceptions import WorkersLostError

if TYPE_CHECKING:
    from .arx.identify import Identification

EXAMPLES = """\
examples:
  skhoid identify                          identify a bundled recording of a human tracker
  skhoid identify run*.csv --input e --output u --time t
  skhoid identify runs.mat --input data.e --output data.u --dt 0.01 --run-in 8.08
  skhoid identify all.parquet --input e --output u --time t --run trial --validate 7 --json
"""

SIMULATE_EXAMPLES = """\
examples:
  skhoid simulate --condition C4 --runs 5 --remnant 0.15 --out runs.parquet
  skhoid identify runs.parquet --input e --output u --time time --run run --keep-means
  skhoid simulate --condition C1 --remnant 0.2 --remnant-order 3 --channels e x f_t --out c1.mat
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str or None, default=None
        Words after ``skhoid``; None means those of the process.

    Returns
    -------
    exit_code : int
        0 on success, 2 on bad input.
    """
    options = _parser().parse_args(arguments)
    if options.debug:
        return int(options.action(options))
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning()
            return int(options.action(options))
    except KeyboardInterrupt:
        return 130
    except (ValueError, OSError, ImportError, WorkersLostError) as error:
        from .exceptions import IrregularSamplingError

        irregular = isinstance(error, IrregularSamplingError) and "resample_runs" in str(error)
        hint = " On the command line: --resample." if irregular else ""
        print(f"skhoid: error: {error}{hint}", file=sys.stderr)
        return 2


def _show_warning() -> Callable[..., None]:
    """Print each warning once, however many fits give it."""
    shown = set()

    def show(message: Any, *_: Any, **__: Any) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            print(f"skhoid: note: {message}", file=sys.stderr)

    return show


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="skhoid", description="Identify human operators from recorded control loops."
    )
    parser.add_argument("--version", action="version", version=f"skhoid {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    command = commands.add_parser(
        "identify",
        help="find delay and orders, fit, and validate on held-out data",
        description="Discard the run-in, find the delay and the orders, fit an ARX model and "
        "validate its free run on held-out data: the last run, or the second half of a single "
        "run. Without files it uses a bundled recording of a person tracking a target.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(action=_identify)
    add = command.add_argument
    add_file_options(add)
    add("--input", nargs="+", default=["e"], metavar="NAME", help="input channels (default: e)")
    add("--run-in", type=float, metavar="S", help="discard this much at the start of each run")
    add(
        "--decimate",
        type=at_least_one,
        default=1,
        metavar="D",
        help="decimation factor (default: 1)",
    )
    add("--longest-delay", type=float, default=0.5, metavar="S", help="default: 0.5")
    add(
        "--criterion",
        choices=["one_step", "vaf"],
        default="one_step",
        help="which delay to go on with (default: one_step); both are printed",
    )
    add("--validate", nargs="+", metavar="RUN", help="runs to hold out (default: the last)")
    add(
        "--keep-means",
        action="store_true",
        help="no intercept, and VAF with the means kept, as the thesis does",
    )
    add("--out", default="skhoid-identify", metavar="FOLDER", help="folder for the pictures")
    add("--no-pictures", action="store_true", help="draw nothing")
    add("--json", action="store_true", help="print the results as JSON")
    add("--debug", action="store_true", help="show tracebacks")

    command = commands.add_parser(
        "simulate",
        help="simulate runs of a tracking task and write them to a file",
        description="Simulate a human operator in the closed loop of the thesis, with remnant, and "
        "write the runs to a file that `skhoid identify` reads.",
        epilog=SIMULATE_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(action=_simulate)
    add = command.add_argument
    add("--condition", default="C1", metavar="C", help="C1 to C6 (Table III; default: C1)")
    add("--runs", type=at_least_one, default=5, metavar="N", help="number of runs (default: 5)")
    add("--remnant", type=float, default=0.0, metavar="P", help="P_n, such as 0.15 (default: 0)")
    add("--remnant-order", default="2", metavar="M", help="1, 2, 3, 4 or nm (default: 2)")
    add("--channels", nargs="+", default=["e"], metavar="NAME", help="e, x, f_t, dist (default: e)")
    add("--rate", type=float, default=100.0, metavar="HZ", help="sampling rate (default: 100)")
    add("--random-phases", action="store_true", help="new phases of the target in each run")
    add("--open-loop", action="store_true", help="remnant does not go round the loop")
    add("--seed", type=int, metavar="N", help="the same number gives the same runs")
    add("--out", required=True, metavar="FILE", help=".csv, .parquet or .mat")
    add("--overwrite", action="store_true", help="replace FILE if it exists")
    add("--picture", metavar="FILE", help="draw the first run, with the spread of the others")
    add("--debug", action="store_true", help="show tracebacks")
    add_effect_commands(commands)
    add_study_command(commands)
    return parser


def _simulate(options: argparse.Namespace) -> int:
    from . import make_tracking_runs, write_runs

    order = options.remnant_order
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    path = Path(options.out)
    if path.exists() and not options.overwrite:
        raise ValueError(f"{path} exists; choose another name, or --overwrite.")
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
        progress=sys.stdout.isatty(),
    )
    write_runs(X, y, path, overwrite=options.overwrite)
    runs = "1 run" if options.runs == 1 else f"{options.runs} runs"
    print(
        f"{path}: {runs} of {options.condition.upper()}, {len(X)} rows at {options.rate:g} Hz, "
        f"seed {seed}"
    )
    if options.remnant:
        by_run = truth.remnant.groupby(level="run").var() / y.groupby(level="run").var()
        print(
            f"remnant: P_n = {by_run.mean():.3f} on average ({by_run.min():.3f} to "
            f"{by_run.max():.3f}), wanted {options.remnant:g}"
        )
    if options.picture:
        without_screen()
        from .plotting import TrackingDisplay

        display: Any = TrackingDisplay.from_runs(X, y, truth=truth)
        display.figure_.savefig(options.picture, dpi=120)
        print(f"picture: {options.picture}")
    column = "" if path.suffix.lower() == ".mat" else " --run run"
    channel = "e" if "e" in options.channels else options.channels[0]
    print(
        f"next: skhoid identify {path} --input {channel} --output u --time time{column} "
        "--keep-means"
    )
    return 0


def _identify(options: argparse.Namespace) -> int:
    from .arx.identify import identify

    X, y, source = _read(options)
    found = identify(
        X,
        y,
        inputs=list(X.columns),
        run_in=options.run_in,
        factor=options.decimate,
        longest_delay=options.longest_delay,
        criterion=options.criterion,
        validation_runs=options.validate,
        centered=not options.keep_means,
        callbacks=() if options.json or not sys.stdout.isatty() else _progress(),
    )
    pictures = [] if options.no_pictures else _draw(found, Path(options.out))
    if options.json:
        print(as_json(_as_dict(found, source, pictures)))
    else:
        _print(found, source, pictures, options.criterion)
    return 0


def _progress() -> tuple[Any, ...]:
    from sklearn.callback import ProgressBar

    return (ProgressBar(max_propagation_depth=0),)


def _read(options: argparse.Namespace) -> tuple[Any, Any, str]:
    if options.files:
        X, y = read_files(options, options.input)
        return X, y, ", ".join(options.files)
    from . import load_human_tracking

    X, y = load_human_tracking("difficulty 80")
    return (
        X,
        y,
        (
            "bundled recording: a person follows a pseudo-random target with a mouse "
            "(Matic 2022, MIT licence)"
        ),
    )


def _draw(found: Identification, folder: Path) -> list[str]:
    without_screen()
    import matplotlib.pyplot as plt

    from .plotting import DelayLossDisplay, SimulationDisplay, VAFContourDisplay

    folder.mkdir(parents=True, exist_ok=True)
    displays: dict[str, Any] = {
        "simulation.png": SimulationDisplay.from_estimator(
            found.best.pipeline, found.X, found.y, centered=found.centered, **found.held_out_view
        ),
        "delay.png": DelayLossDisplay.from_estimator(
            found.delay_search, unit=found.units.get(str(found.y.name))
        ),
        "delay-vaf.png": DelayLossDisplay.from_estimator(found.vaf_delay_search),
        "orders.png": VAFContourDisplay.from_estimator(found.order_search),
    }
    for name, display in displays.items():
        display.figure_.savefig(folder / name, dpi=120)
        plt.close(display.figure_)
    return [str(folder / name) for name in displays]


def _as_dict(found: Identification, source: str, pictures: list[str]) -> dict[str, Any]:
    layout = found.layout
    return {
        "skhoid": __version__,
        "source": source,
        "inputs": found.best.model.inputs_,
        "output": found.y.name,
        "units": found.units,
        "n_runs": len(layout.labels),
        "n_rows": layout.n_rows,
        "dt_s": layout.dt,
        "jitter": layout.jitter,
        "n_gaps": found.n_gaps,
        "model_dt_s": found.best.model.dt_,
        "centered": found.centered,
        "estimation": found.estimation,
        "validation": found.validation,
        "delay": {
            search.criterion: {"nk": search.best_nk_, "seconds": search.best_delay_}
            for search in (found.delay_search, found.vaf_delay_search)
        },
        "models": [model.as_dict() for model in found.models],
        "pictures": pictures,
    }


def _clock(found: Identification) -> str:
    jitter, gaps = found.layout.jitter, found.n_gaps
    text = "regular clock" if jitter < 1e-4 else f"jitter {100 * jitter:.2g} %"
    return text + (f", {gaps} gaps at which the free run restarts from zero" if gaps else "")


def _print(found: Identification, source: str, pictures: list[str], criterion: str) -> None:
    from rich.console import Console
    from rich.table import Table

    layout, best = found.layout, found.best.model
    units = found.units

    def named(channel: str) -> str:
        return f"{channel} ({units[channel]})" if channel in units else channel

    # Piped output has no width of its own; 100 columns hold the tables.
    width = None if sys.stdout.isatty() else 100
    console = Console(highlight=False, markup=False, soft_wrap=True, width=width)
    runs = "1 run" if len(layout.labels) == 1 else f"{len(layout.labels)} runs"
    console.print(source)
    console.print(
        f"{runs}, {layout.n_rows} rows, dt = {layout.dt:.6g} s ({1 / layout.dt:.6g} Hz), "
        f"{_clock(found)}; input {', '.join(map(named, best.inputs_))}, "
        f"output {named(str(found.y.name))}"
    )
    console.print(f"fitted on  {found.estimation}\nheld out   {found.validation}\n")

    if best.dt_ > layout.dt:
        console.print(f"the models run at dt = {best.dt_:.6g} s, which their samples count\n")
    delays = Table(title="Delay", title_justify="left")
    for heading in ("criterion", "samples", "seconds", ""):
        delays.add_column(heading, justify="left" if heading in ("criterion", "") else "right")
    for search, what in (
        (found.delay_search, "lowest one-step error"),
        (found.vaf_delay_search, "highest cross-validated VAF"),
    ):
        used = "used below" if search.criterion == criterion else ""
        delays.add_row(what, str(search.best_nk_), f"{search.best_delay_:.4g}", used)
    console.print(delays)
    apart = abs(found.delay_search.best_nk_ - found.vaf_delay_search.best_nk_)
    if apart > 1:
        console.print(f"The criteria are {apart} samples apart: see how flat the curves are.")

    table = Table(
        title="Free run" + (", about the means" if found.centered else ", means kept"),
        title_justify="left",
    )
    for heading in ("model", "[na, nb, nk]", "VAF fitted, %", "VAF held out, %", "ratio", ""):
        table.add_column(heading, justify="left" if heading in ("model", "") else "right")
    for model in found.models:
        orders = model.model.orders_
        nb, nk = (v[0] if len(set(v)) == 1 else list(v) for v in (orders.nb, orders.nk))
        table.add_row(
            model.name,
            f"{orders.na}, {nb}, {nk}",
            f"{model.vaf_estimation:.2f}",
            f"{model.vaf_validation:.2f}",
            f"{model.ratio:.3f}" if model.vaf_validation > 0 else "-",
            model.verdict,
        )
    console.print(table)

    parameters = Table(title=f"Parameters, {found.best.name}", title_justify="left")
    for heading in ("name", "value", "standard error"):
        parameters.add_column(heading, justify="left" if heading == "name" else "right")
    for name, value, error in zip(
        best.parameter_names_, best.coef_, best.standard_errors_, strict=True
    ):
        parameters.add_row(name, f"{value:.5g}", f"{error:.2g}")
    console.print(parameters)
    console.print(
        "Standard errors concern the ARX model's own parameters and allow for a coloured error. "
        "They do not include the bias that remnant causes in a closed loop."
    )
    if pictures:
        console.print(f"Pictures: {', '.join(pictures)}")


if __name__ == "__main__":
    sys.exit(main())
