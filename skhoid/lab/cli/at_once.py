"""What can be refused before NumPy is imported, which takes seconds."""

from __future__ import annotations

import argparse

from ...exceptions import did_you_mean
from .arguments.names import EFFECTS
from .options import refuse

ABOUT_FILES = ["time", "dt", "run", "subject", "condition", "unit", "resample"]
ABOUT_FILES += ["input", "instruments", "output", "x", "target", "role", "display"]
BUNDLED = ("identify", "diagnose", "report", "experiment")  # which have recordings of their own
NO_SEARCH = ("report", "experiment")  # which can do without


def refuse_at_once(options: argparse.Namespace) -> None:
    """Refuse options that have no effect, and effects that there are not."""
    if options.command in BUNDLED and not options.files:
        refuse(
            options,
            ABOUT_FILES,
            "is about files, and there are none. Options that take several words also take files "
            "that follow: name the files first.",
        )
    if "tables" in options and options.tables is None:
        refuse(options, ["table_format"], "needs --tables FOLDER: else no tables are written.")
    _check_effects(getattr(options, "effects", None) or ["all"], options.command)


def _check_effects(names: list[str], command: str) -> None:
    if names == ["all"] or (names == ["none"] and command in NO_SEARCH):
        return
    if "all" in names:
        raise ValueError("--effects all takes no other names: it is all of them.")
    if "none" in names:
        raise ValueError(
            "--effects none stands alone, in skhoid report and experiment, which then make no "
            "search; else name the effects to search for, or leave --effects out to search for all."
        )
    unknown = next((name for name in names if name not in EFFECTS), None)
    if unknown is not None:
        raise ValueError(
            f"No effect is called {unknown!r}. The effects are: {', '.join(EFFECTS)}."
            f"{did_you_mean(unknown, EFFECTS)}"
        )
