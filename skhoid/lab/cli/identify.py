"""The command ``skhoid identify``: delay, orders, and a model validated on held-out data."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import skhoid

from ... import __version__
from .files import (
    check_tables,
    column_of,
    columns_dict,
    figure_folder,
    names_of,
    read_files,
    save_figures,
    save_tables,
    without_screen,
)
from .output import (
    message_for,
    print_bold,
    print_json,
    print_source,
    print_table,
    print_wrapped,
    say_files,
    say_next,
    typed,
)
from .parser import (
    DOMAINS,
    add_command,
    add_file_options,
    add_lost_control,
    add_output_options,
    add_plot_options,
    add_run_in,
    at_least_one,
    not_negative,
    order,
    positive,
    read_roles,
    refuse,
    samples,
)

EXAMPLES = """\
examples:
  skhoid identify                        a bundled recording of a human tracker
  skhoid identify run*.csv               columns are guessed, and said
  skhoid identify runs.mat --dt 0.01 --run-in 8.08
  skhoid identify all.parquet --run trial --validate 7 --json
  skhoid identify run*.csv --na 2 --nb 2 --nk 29      nothing is searched
  skhoid identify run*.csv --method iv --instruments f_t
  skhoid identify run*.csv --memory-time 2.56         a person who adapts
"""
LONGEST_DELAY = 0.5  # s
PICTURES = ["simulation.png", "delay.png", "delay-vaf.png", "orders.png", "parameters.png"]
CRITERIA = {"one_step": "lowest one-step error", "vaf": "highest cross-validated VAF"}


def add_identify(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "identify",
        "find delay and orders, fit, and validate on held-out data",
        "Discard the run-in, find the delay and the orders, fit an ARX model and "
        "validate its free run on held-out data: the last run, or the second half of a single "
        "run. Without files it uses a bundled recording of a person tracking a target.",
        EXAMPLES,
        "[FILES] [OPTIONS]",
    )
    command.set_defaults(work=identify)
    add = command.section("Data")
    add_file_options(add)
    add(
        "--input",
        nargs="+",
        metavar="NAME",
        help="input columns; then no other channel is guessed (default: guessed, the error)",
    )
    add("--x", metavar="NAME", help="the controlled element's output, for the leak test")
    add("--target", metavar="NAME", help="the target f_t, for the same")
    add_run_in(add)
    add_lost_control(add)
    add(
        "--decimate",
        type=at_least_one,
        default=1,
        metavar="D",
        help="decimation factor (default: 1)",
    )
    add = command.section("Search")
    add(
        "--longest-delay",
        type=positive,
        metavar="S",
        help=f"longest delay to try (default: {LONGEST_DELAY})",
    )
    add(
        "--least-delay",
        type=not_negative,
        metavar="S",
        help="shortest delay of e and x to try (default: 0.1 of a person, a sample of a machine)",
    )
    add(
        "--domain",
        choices=DOMAINS,
        help="who controls (default: human where e is given with x or f_t)",
    )
    add(
        "--role",
        action="append",
        default=[],
        metavar="NAME=ROLE",
        help="role of an input of another name: e, x, f_t; may be repeated",
    )
    add(
        "--criterion",
        choices=["one_step", "vaf"],
        help="which delay to go on with (default: one_step); both are printed",
    )
    add = command.section("Model")
    several = "; one number, or one per input"
    add(
        "--nk",
        type=samples,
        nargs="+",
        metavar="N",
        help=f"delay in samples, not searched{several}",
    )
    add("--na", type=order, metavar="N", help="order, not searched (nb: 2, or as given)")
    add(
        "--nb",
        type=order,
        nargs="+",
        metavar="N",
        help=f"order, not searched (na: 2, or as given){several}",
    )
    add(
        "--method",
        choices=["ols", "iv"],
        default="ols",
        help="least squares, or instrumental variables, which remnant does not bias "
        "(default: ols); searches use least squares",
    )
    add(
        "--instruments",
        nargs="+",
        metavar="NAME",
        help="of iv: channels from outside the loop (default: f_t)",
    )
    add(
        "--memory-time",
        type=positive,
        metavar="S",
        help="also fit a model that follows changes, with a memory of this length",
    )
    add("--memory-horizon", type=positive, metavar="N", help="the same in samples of the model")
    add = command.section("Validation")
    add("--validate", nargs="+", metavar="RUN", help="runs to hold out (default: the last)")
    add(
        "--keep-means",
        action="store_true",
        help="no intercept, and VAF with the means kept, as the thesis does",
    )
    add = command.section("Output")
    add_plot_options(add, "skhoid-identify")
    add_output_options(add)


def identify(options: argparse.Namespace) -> int:
    """Identify, and say, draw and write what is found."""
    from ...diagnosis import ModelChoice
    from ...diagnosis import identify as identify_runs

    folder = figure_folder(options, "skhoid-identify")
    check_tables(options)
    if options.nk is not None:
        of_search = ["longest_delay", "least_delay", "criterion"]
        refuse(options, of_search, "needs a search, and --nk gives the delay.")
    if options.memory_time is not None:
        refuse(options, ["memory_horizon"], "and --memory-time say the same: give one of them.")
    if options.method != "iv":
        refuse(options, ["instruments"], "needs --method iv.")
    criterion = options.criterion or "one_step"
    X, y, instruments, roles, source = _read(options)
    n_inputs = len(options.input) if options.input else X.shape[1]
    memory = {name: getattr(options, name) for name in ("memory_time", "memory_horizon")}
    choice = ModelChoice(
        inputs=list(X.columns[:n_inputs]),
        na=options.na,
        nb=_one_or_each(options.nb),
        nk=_one_or_each(options.nk),
        method=options.method,
        instruments=instruments or None,
        memory={name: value for name, value in memory.items() if value is not None},
        least_delay=options.least_delay,
        domain=options.domain,
        roles=roles or None,
        lost_control=options.lost_control,
    )
    found = identify_runs(
        X,
        y,
        choice,
        run_in=options.run_in,
        factor=options.decimate,
        longest_delay=options.longest_delay or LONGEST_DELAY,
        criterion=criterion,
        validation_runs=options.validate,
        centered=not options.keep_means,
        callbacks=() if options.json or not sys.stdout.isatty() else _progress(),
    )
    files = {
        "pictures": [] if folder is None else _draw(found, folder, options.format),
        "tables": save_tables(found.tables, options),
    }
    if options.json:
        print_json({**_as_dict(found, source, columns_dict(options)), **files})
    else:
        _print(found, source, criterion, options)
        say_files(files)
        say_next([(_next_command(options), "which effects is the model missing?")])
    return 0


def _one_or_each(numbers: list[int] | None) -> Any:
    return numbers[0] if numbers is not None and len(numbers) == 1 else numbers


def _progress() -> tuple[Any, ...]:
    from sklearn.callback import ProgressBar

    return (ProgressBar(max_propagation_depth=0),)


def _next_command(options: argparse.Namespace) -> str:
    """The command that says what the model is missing; it takes one input at most."""
    if len(getattr(options, "named_input", None) or []) > 1:
        options = argparse.Namespace(**{**vars(options), "named_input": None})
    return typed(options, "diagnose")


def _read(options: argparse.Namespace) -> tuple[Any, Any, list[str], dict[str, str], str]:
    """X, y, the instruments and roles of columns of X, and where they are from."""
    roles = read_roles(options)
    if options.files:
        return _own(options, roles)
    X, y = skhoid.load_human_tracking("difficulty 80")
    return (
        X,
        y,
        [],
        roles,
        (
            "bundled recording: a person follows a pseudo-random target with a mouse "
            "(Matic 2022, MIT licence)"
        ),
    )


def _own(
    options: argparse.Namespace, roles: dict[str, str]
) -> tuple[Any, Any, list[str], dict[str, str], str]:
    from ...runs import role_of
    from ..guessing import UnclearColumnsError

    asked = options.named_input = list(options.input or [])
    others = (options.instruments or ["f_t"]) if options.method == "iv" else []
    inside = [name for name in others if name in asked]
    if inside:
        raise ValueError(f"{inside[0]!r} is an input and cannot be its own instrument.")
    if options.x in asked and options.x not in roles:
        raise ValueError(
            f"--x names {options.x!r}, which is an input: name different channels, or say "
            f"--role {options.x}=x if the model is to answer x."
        )
    for name, role in ((options.x, "x"), (options.target, "f_t")):
        if name is not None and roles.setdefault(name, role) != role:
            raise ValueError(f"--role says that {name!r} is {roles[name]!r}, and not {role!r}.")
    beside = [name for name in (options.x, options.target) if name not in (None, *asked)]
    of_guess = not asked and options.instruments is None  # the target, if there is one
    wanted = [*asked, *([] if of_guess else others), *beside]
    given = {name: roles.get(name, str(role_of(name))) for name in dict.fromkeys(wanted)}
    try:
        found = read_files(options, given | roles, signals=not asked)
    except UnclearColumnsError as error:
        if others and options.instruments is None and "f_t" not in error.columns:
            raise ValueError(
                f"{error} --method iv takes 'f_t' as its instrument, unless --instruments "
                "names others."
            ) from error
        raise
    X, guess = found.X, found.guess
    inputs = [column_of(X, name) for name in asked] or guess.inputs
    rest = [name for name in X.columns if name not in inputs]
    attributes = dict(X.attrs)
    X = X[[*inputs, *rest]]
    X.attrs = attributes
    options.input = inputs
    of_columns = guess.roles | {column_of(X, name): role for name, role in roles.items()}
    return X, found.y, _instruments(X, others, of_columns), of_columns, names_of(options.files)


def _instruments(X: Any, names: list[str], roles: dict[str, str]) -> list[str]:
    from ...runs import role_of

    columns = {role_of(column, roles): column for column in X.columns}
    found = [columns["f_t"] if n == "f_t" and "f_t" in columns else column_of(X, n) for n in names]
    missing = [name for name in found if name not in X.columns]
    if missing:
        raise ValueError(
            f"--method iv takes {missing[0]!r} as its instrument, unless --instruments names "
            "others; the files have no such channel."
        )
    return found


def _draw(found: Any, folder: Path, form: str | None) -> list[str]:
    without_screen()
    show = skhoid.plotting
    displays: dict[str, Any] = {
        "simulation.png": show.SimulationDisplay.from_estimator(
            found.best.pipeline, found.X, found.y, centered=found.centered, **found.held_out_view
        )
    }
    if found.delay_searches:
        displays["delay.png"] = show.DelayLossDisplay.from_estimator(
            found.delay_searches["one_step"], unit=found.units.get(str(found.y.name))
        )
        displays["delay-vaf.png"] = show.DelayLossDisplay.from_estimator(
            found.delay_searches["vaf"]
        )
    if found.order_search is not None:
        displays["orders.png"] = show.VAFContourDisplay.from_estimator(found.order_search)
    if found.adapting is not None:
        displays["parameters.png"] = show.ParametersDisplay.from_estimator(
            {m.name: m.model for m in (found.adapting, found.best)}
        )
    figures = {name: d.figure_ for name, d in displays.items()}
    more: dict[str, Any] = {"others": PICTURES, "named": (found.X, found.y)}
    return save_figures(figures, folder, "identify", form=form or "png", **more)


def _as_dict(found: Any, source: str, columns: Any) -> dict[str, Any]:
    layout = found.layout
    return {
        "skhoid": __version__,
        "source": source,
        "columns": columns,
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
            criterion: {"nk": search.best_nk_, "seconds": search.best_delay_}
            for criterion, search in found.delay_searches.items()
        },
        "domain": found.least_delay.domain,
        "least_delay": {
            "nk": found.least_delay.samples,
            "seconds": found.least_delay.seconds,
        },
        "left_out": found.left_out.to_dict("records"),
        "notes": list(map(str, found.notes)),
        "models": [model.as_dict() for model in found.models],
        "adapting": found.adapting.as_dict() if found.adapting else None,
    }


def _clock(found: Any) -> str:
    jitter, gaps = found.layout.jitter, found.n_gaps
    text = "regular clock" if jitter < 1e-4 else f"jitter {100 * jitter:.2g} %"
    return text + (f", {gaps} gaps at which the free run restarts from zero" if gaps else "")


def _print(found: Any, source: str, criterion: str, options: argparse.Namespace) -> None:
    from ...text import counted

    layout, best, units = found.layout, found.best.model, found.units

    def named(channel: str) -> str:
        return f"{channel} ({units[channel]})" if channel in units else channel

    print_source(options, source)
    print_wrapped(
        f"Measured: {counted(len(layout.labels), 'run')}, {layout.n_rows} rows at "
        f"{1 / layout.dt:.6g} Hz (dt = {layout.dt:.6g} s), {_clock(found)}"
    )
    print_wrapped(
        f"  input {', '.join(map(named, best.inputs_))}, output {named(str(found.y.name))}"
    )
    print_wrapped(f"  fitted on {found.estimation}; held out {found.validation}")
    if best.dt_ > layout.dt:
        print_wrapped(f"  the models run at dt = {best.dt_:.6g} s, which their samples count")
    print()
    chosen = found.best
    print_bold(
        f"Verdict: held-out VAF {chosen.vaf_validation:.1f} % "
        f"({chosen.name}{'; about the mean' if found.centered else ''}): {chosen.verdict}"
    )
    for note in found.notes:
        print_wrapped(f"  note: {message_for(note, options)}")
    print()
    _print_models(found)
    if found.delay_searches:
        _print_delays(found, criterion)
    parameters = [
        (str(name), f"{value:.5g}", f"{error:.2g}")
        for name, value, error in zip(
            best.parameter_names_, best.coef_, best.standard_errors_, strict=True
        )
    ]
    print()
    title = f"Parameters, {chosen.name}, ± one standard error"
    print_table(title, ["name", "value", "±"], parameters, left=["name"])
    bias = (
        "They do not include the bias that remnant causes in a closed loop."
        if best.method == "ols"
        else "Instrumental variables: remnant does not bias them."
    )
    print_wrapped(
        "  Standard errors concern the ARX model's own parameters and allow for a coloured error. "
        + bias
    )
    print()


def _print_models(found: Any) -> None:
    rows = []
    for model in found.fitted:
        orders = model.model.orders_
        nb, nk = (v[0] if len(set(v)) == 1 else list(v) for v in (orders.nb, orders.nk))
        figures = [f"{model.vaf_estimation:.2f}", f"{model.vaf_validation:.2f}"]
        ratio = f"{model.ratio:.3f}" if model.vaf_validation > 0 else "-"
        rows.append([model.name, f"{orders.na}, {nb}, {nk}", *figures, ratio, model.verdict])
    headings = ["model", "na, nb, nk", "fitted", "held out", "ratio", ""]
    title = "VAF of the simulated output, %, " + (
        "about the means" if found.centered else "means kept"
    )
    print_table(title, headings, rows, left=["model", ""], folded=["model", ""])


def _print_delays(found: Any, criterion: str) -> None:
    rows = [
        (
            CRITERIA[name],
            str(search.best_nk_),
            f"{search.best_delay_:.4g}",
            "used above" if name == criterion else "",
        )
        for name, search in found.delay_searches.items()
    ]
    print()
    headings = ["criterion", "samples", "seconds", ""]
    print_table("Delay", headings, rows, left=["criterion", ""])
    one_step, vaf = (search.best_nk_ for search in found.delay_searches.values())
    if abs(one_step - vaf) > 1:
        print_wrapped(
            f"  The criteria are {abs(one_step - vaf)} samples apart: see how flat the curves are."
        )
