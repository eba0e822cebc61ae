"""Recordings and the model of them: what ``diagnose`` and ``report`` have in common."""

from __future__ import annotations

import argparse
from typing import Any

from ...arx.batch import ARXRegressor
from ...arx.searches import DelaySearchCV
from ...io import load_human_tracking
from ...model import OperatorRegressor
from ...preprocessing import RunInTrimmer
from ...preprocessing.means import about_means
from .arguments.shared import OF_CORE
from .files import column_of, names_of, read_files
from .options import pairs, refuse

BUNDLED = ["phase-size 2b", "phase-size 2c", "phase-size 2d", "phase-size 2e"]


def read_recordings(options: argparse.Namespace) -> tuple[Any, Any, Any, str]:
    """X, y, the model of them, and where they are from; the user's files, or bundled ones."""
    for core, names in OF_CORE.items():
        if core != options.core:
            refuse(options, names, f"needs --core {core}.")
    X, y, roles, source = _own(options) if options.files else _bundled(options)
    if options.run_in:
        X = RunInTrimmer(run_in=options.run_in).fit_transform(X)
    if options.remove_means:
        X, y = about_means(X), about_means(y)
    return X, y, _estimator(options, X, y, roles), source


def _own(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    # On a pursuit display the input is the target itself.
    asked = options.input
    is_target = asked in (options.target, "f_t") or (asked or "").endswith(".f_t")
    named = [
        ("--input", asked, "f_t" if is_target else "e"),
        ("--x", options.x, "x"),
        ("--target", options.target, "f_t"),
    ]
    roles = pairs(options.role, "--role", "NAME=ROLE, such as roll=motion")
    said = dict.fromkeys(roles, "--role")
    for option, name, role in named:
        if name is None:
            continue
        if roles.setdefault(name, role) != role:
            raise ValueError(
                f"The channel {name!r} has two roles, {roles[name]!r} by {said[name]} and {role!r} "
                f"by {option}: name different channels."
            )
        said[name] = option
    options.named_input = [] if asked is None else [asked]
    found = read_files(options, roles, signals=asked is None)
    X, guess = found.X, found.guess
    of_columns = guess.roles | {column_of(X, name): role for name, role in roles.items()}
    options.input = column_of(X, asked) if asked is not None else guess.inputs[0]
    return X, found.y, of_columns, names_of(options.files)


def _bundled(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    X, y = load_human_tracking(BUNDLED)
    options.display, options.remove_means = "pursuit", True
    source = (
        "bundled recordings: a person follows a pseudo-random target with a mouse, four times, "
        "positions about their mean (Matic 2022, MIT licence)"
    )
    options.input = "f_t"  # the answer to the target, which is what a pursuit display shows
    return X, y, {}, source


def _estimator(options: argparse.Namespace, X: Any, y: Any, roles: dict[str, str]) -> Any:
    inputs = [column_of(X, options.input)]
    shared: dict[str, Any] = {"inputs": inputs, "roles": roles or None}
    if options.core == "operator":
        return OperatorRegressor(delay=options.delay, **shared)
    orders = {name: getattr(options, name) for name in OF_CORE["arx"]}
    shared |= {name: value for name, value in orders.items() if value is not None}
    arx = ARXRegressor(**shared)
    if options.nk is not None:
        return arx
    return arx.set_params(nk=DelaySearchCV(arx).fit(X, y).best_nk_)
