"""The command ``skhoid identify``: delay, orders, and a model validated on held-out data."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import skhoid

from .files import (
    check_tables,
    describe_runs,
    figure_folder,
    find_column,
    model_file,
    read_files,
    save_figures,
    save_model,
    save_tables,
    show_names,
    without_screen,
)
from .output import (
    compared_next,
    print_document,
    print_json,
    print_source,
    print_wrapped,
    say_files,
    say_next,
    shows_progress,
    typed,
)
from .parser import (
    DOMAINS,
    add_channel_options,
    add_command,
    add_decimate,
    add_file_options,
    add_lost_control,
    add_output_options,
    add_plot_options,
    add_save,
    not_negative,
    order,
    positive,
    read_roles,
    refuse,
    samples,
)

ABOUT = """\
find delay and orders, fit, and validate on held-out data
Discard the run-in, find the delay and the orders, fit an ARX model and validate its free run on
held-out data: the last run, or the second half of a single run. Without files it uses a bundled
recording of a person tracking a target."""
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
PICTURES = ["simulation", "delay", "delay-vaf", "orders", "parameters"]
CRITERIA = {
    "impulse": "likeliest impulse response",
    "one_step": "lowest one-step error",
    "vaf": "highest cross-validated VAF, {}",
}


def add_identify(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, identify, ABOUT, "[FILES] [OPTIONS]", EXAMPLES)
    add = command.section("Data")
    add_file_options(add)
    text = "input columns; then no other channel is guessed (default: guessed, the error)"
    add("--input", nargs="+", metavar="NAME", help=text)
    add_channel_options(add)
    add_lost_control(add)
    add = command.section("Search")
    text = "longest delay to try (default: 0.5, or less in short runs)"
    add("--longest-delay", type=positive, metavar="S", help=text)
    text = "shortest delay of e and x to try (default: 0.1 of a person, a sample of a machine)"
    add("--least-delay", type=not_negative, metavar="S", help=text)
    text = "who controls (default: human where e is given with x or f_t)"
    add("--domain", choices=DOMAINS, help=text)
    add = command.section("Model")
    add_decimate(add)
    several = "; one number, or one per input"
    text = f"delay in samples, not searched{several}"
    add("--nk", type=samples, nargs="+", metavar="N", help=text)
    add("--na", type=order, metavar="N", help="order, not searched (nb: 2, or as given)")
    text = f"order, not searched (na: 2, or as given){several}"
    add("--nb", type=order, nargs="+", metavar="N", help=text)
    text = "least squares; instrumental variables, which noise does not bias; output error, "
    text += "Box-Jenkins, ARMAX (default: ols; searches use least squares)"
    add("--method", choices=["ols", "iv", "oe", "bj", "armax"], default="ols", help=text)
    text = "of iv: channels from outside the loop, or the input if nothing feeds the output back "
    text += "(default: f_t)"
    add("--instruments", nargs="+", metavar="NAME", help=text)
    text = "also fit a model that follows changes, with a memory of this length"
    add("--memory-time", type=positive, metavar="S", help=text)
    add("--memory-horizon", type=positive, metavar="N", help="the same in samples of the model")
    add = command.section("Validation")
    add("--validate", nargs="+", metavar="RUN", help="runs to hold out (default: the last)")
    text = "no intercept, and VAF with the means kept, as the thesis does"
    add("--keep-means", action="store_true", help=text)
    add = command.section("Output")
    add_save(add)
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_plot_options(add, "skhoid-identify")
    add_output_options(add)


def identify(options: argparse.Namespace) -> int:
    """Identify, and say, draw and write what is found."""
    import numpy as np

    from ...diagnosis import ModelChoice
    from ...diagnosis import identify as identify_runs
    from ...runs import run_name

    folder = figure_folder(options, "skhoid-identify")
    check_tables(options)
    if options.save is None:
        refuse(options, ["overwrite"], "is for the file of --save FILE.")
    model = model_file(options)
    if options.nk is not None:
        of_search = ["longest_delay", "least_delay"]
        refuse(options, of_search, "needs a search, and --nk gives the delay.")
    if options.memory_time is not None:
        refuse(options, ["memory_horizon"], "and --memory-time say the same: give one of them.")
    if options.method != "iv":
        refuse(options, ["instruments"], "needs --method iv.")
    X, y, inputs, instruments, roles, source = _read(options)
    memory = {name: getattr(options, name) for name in ("memory_time", "memory_horizon")}
    choice = ModelChoice(
        inputs=inputs,
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
        longest_delay=options.longest_delay,
        validation_runs=options.validate,
        centered=not options.keep_means,
        callbacks=_progress() if shows_progress(options) else (),
    )
    layout = found.layout
    names = [run_name(layout.labels[run]) for run in layout.run_of(np.arange(layout.n_rows))]
    files = {
        "model": save_model(found.best.pipeline, model, options, (names, ~found.held_out)),
        "pictures": [] if folder is None else _draw(found, folder, options),
        "tables": save_tables(found.tables, options),
    }
    if options.json:
        print_json(options, {"source": source, **_list_numbers(found), **files})
        return 0
    print_source(options, source)
    print_wrapped(describe_runs(found.layout, found.best.model.inputs_, y, found.units))
    print()
    print_document(_tell(found), options)
    print()
    say_files(files)
    say_next([_find_next_step(options), *compared_next(options)])
    return 0


def _find_next_step(options: argparse.Namespace) -> tuple[str, str]:
    """The search for effects, which has one input: others are channels that effects may use."""
    why, others = "which effects is the model missing?", {}
    if options.input:
        first, *more = options.input
        roles = [f"{name}=" for name in more if name not in (options.x, options.target)]
        others = {"input": first, "role": [*options.role, *roles]}
        why = f"which effects is a model of {first!r} alone missing?" if more else why
    if options.na is not None or options.nb is not None or options.nk is not None:
        orders = {name: getattr(options, name) for name in ("nb", "nk")}
        one = {name: value[0] for name, value in orders.items() if value}
        others |= {"core": "arx", **one}
    return typed(options, "diagnose", **others), why


def _one_or_each(numbers: list[int] | None) -> Any:
    return numbers[0] if numbers is not None and len(numbers) == 1 else numbers


def _progress() -> tuple[Any, ...]:
    from ..._sklearn import list_progress_bars

    return list_progress_bars(max_propagation_depth=0)


def _read(
    options: argparse.Namespace,
) -> tuple[Any, Any, list[str], list[str], dict[str, str], str]:
    """X, y, inputs, instruments and roles of columns of X, and where they are from."""
    from ...runs import role_of
    from ..guessing import UnclearColumnsError

    if not options.files:
        X, y = skhoid.load_human_tracking("difficulty 80")
        source = "bundled recording: a person follows a pseudo-random target with a mouse "
        return X, y, list(X.columns), [], {}, source + "(Matic 2022, MIT licence)"
    asked = list(options.input or [])
    others = (options.instruments or ["f_t"]) if options.method == "iv" else []
    roles = read_roles(options, {name: "e" for name in asked if name != options.target})
    # Of a guess the target is a channel already, if there is one.
    wanted = [*asked, *(others if asked or options.instruments else [])]
    given = {name: str(role_of(name)) for name in wanted} | roles
    try:
        X, y, guess = read_files(options, given, signals=not asked)
    except UnclearColumnsError as error:
        if others and options.instruments is None and "f_t" not in error.columns:
            raise ValueError(f"{error} {_of_instruments('f_t')}") from error
        raise
    inputs = [find_column(X, name) for name in asked] or guess.inputs
    roles = guess.roles | {find_column(X, name): role for name, role in roles.items()}
    columns = {role_of(column, roles): column for column in X.columns}
    instruments = [
        columns["f_t"] if name == "f_t" and "f_t" in columns else find_column(X, name)
        for name in others
    ]
    missing = [name for name in instruments if name not in X.columns]
    if missing:
        raise ValueError(f"{_of_instruments(missing[0])} The files have no such channel.")
    return X, y, inputs, instruments, roles, show_names(options.files)


def _of_instruments(name: str) -> str:
    return (
        f"--method iv takes {name!r} as its instrument, unless --instruments names others: the "
        "input itself, where nothing feeds the output back."
    )


def _draw(found: Any, folder: Path, options: argparse.Namespace) -> list[str]:
    without_screen()
    show = skhoid.plotting
    displays: dict[str, Any] = {
        "simulation": show.SimulationDisplay.from_estimator(
            found.best.pipeline, found.X, found.y, centered=found.centered, **found.held_out_view
        )
    }
    searches = found.delay_searches
    if searches:
        unit = found.units.get(str(found.y.name))
        draw = show.DelayLossDisplay.from_estimator
        displays |= {
            "delay": draw(next(iter(searches.values())), unit=unit),
            "delay-vaf": draw(searches["vaf"]),
        }
    if found.order_search is not None:
        displays["orders"] = show.VAFContourDisplay.from_estimator(found.order_search)
    if found.adapting is not None:
        displays["parameters"] = show.ParametersDisplay.from_estimator(
            {m.name: m.model for m in (found.adapting, found.best)}
        )
    figures = {name: d.figure_ for name, d in displays.items()}
    more: dict[str, Any] = {"others": PICTURES, "named": (found.X, found.y)}
    return save_figures(figures, folder, "identify", options.format, **more)


def _list_numbers(found: Any) -> dict[str, Any]:
    layout, least = found.layout, found.least_delay
    return {
        "inputs": found.best.model.inputs_,
        "output": found.y.name,
        "units": found.units,
        "n_runs": len(layout.labels),
        "n_rows": layout.n_rows,
        "dt_s": layout.dt,
        "jitter": layout.jitter,
        "n_gaps": found.n_gaps,
        "centered": found.centered,
        "estimation": found.estimation,
        "validation": found.validation,
        "delay": {
            criterion: {"nk": search.best_nk_, "seconds": search.best_delay_}
            for criterion, search in found.delay_searches.items()
        },
        "domain": least.domain,
        "least_delay": {"nk": least.samples, "seconds": least.seconds},
        "left_out": found.left_out.to_dict("records"),
        "notes": list(map(str, found.notes)),
        "models": [model.as_dict() for model in found.models],
        "adapting": found.adapting.as_dict() if found.adapting else None,
    }


def _tell(found: Any) -> Any:
    """The identification as a document."""
    from ...search import parameters_table
    from ...text import Document, Notes, Paragraph

    chosen, means = found.best, "about the mean" if found.centered else "about zero"
    bias = "Instrumental variables: remnant does not bias them."
    if chosen.model.method == "ols":
        bias = "They do not include the bias that remnant causes in a closed loop."
    clock = ""
    if found.layout.jitter >= 1e-4:
        clock += f"; the clock has a jitter of {100 * found.layout.jitter:.2g} %"
    if found.n_gaps:
        clock += f"; {found.n_gaps} gaps, at which the free run restarts from zero"
    return Document(
        f"Verdict: held-out VAF {chosen.vaf_validation:.1f} % ({chosen.name}; {means}): "
        f"{chosen.verdict}",
        [
            Paragraph(f"Fitted on {found.estimation}; held out {found.validation}{clock}."),
            Notes(found.notes),
            _table_of_models(found, means),
            Paragraph(
                "fit: that of MATLAB's compare. offset: mean of measured less simulated. Both are "
                "of the held-out rows."
            ),
            *([_table_of_delays(found, means)] if found.delay_searches else []),
            parameters_table(chosen.model),
            Paragraph(
                "Standard errors concern the ARX model's own parameters and allow for a coloured "
                f"error. {bias}"
            ),
        ],
    )


def _table_of_models(found: Any, means: str) -> Any:
    from ...text import DASH, TextTable, number

    rows = []
    for one in found.fitted:
        orders = one.model.orders_
        nb, nk = (v[0] if len(set(v)) == 1 else list(v) for v in (orders.nb, orders.nk))
        figures = [f"{one.vaf_estimation:.2f}", f"{one.vaf_validation:.2f}"]
        ratio = f"{one.ratio:.3f}" if one.vaf_validation > 0 else DASH
        figures += [ratio, f"{one.fit:.1f}", number(one.offset), str(one.verdict)]
        rows.append([one.name, f"{orders.na}, {nb}, {nk}", *figures])
    header = ["model", "na, nb, nk", "fitted", "held out", "ratio", "fit", "offset", "verdict"]
    title = f"VAF of the simulated output, %, {means}"
    return TextTable(title, header, rows, left=("model", "verdict"))


def _table_of_delays(found: Any, means: str) -> Any:
    from ...text import TextTable

    rows = [
        [
            CRITERIA[name].format(means) + ", used above" * (i == 0),
            str(search.best_nk_),
            f"{search.best_delay_:.4g}",
        ]
        for i, (name, search) in enumerate(found.delay_searches.items())
    ]
    return TextTable("Delay", ["criterion", "samples", "seconds"], rows, left=("criterion",))
