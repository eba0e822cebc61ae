"""Messages of the package, with the command-line options that do what they say in Python."""

from __future__ import annotations

import argparse
import re
import shlex

from ...exceptions import PYTHON_ONLY

# What a message names, and the option that does the same, of commands that have it.
OPTION = {
    r"\bresample_runs\b": "resample",
    r"\bdt=": "dt",
    r"\btime=": "time",
    r"\brun=": "run",
    r"\bunits=": "unit",
    r"\binputs?=": "input",
    r"\broles=": "role",
    r"\brun_in=": "run_in",
    r"\bmeasurement_time=": "measurement_time",
    r"\beffects=": "effects",
    r"\bmax_effects\b": "max_effects",
    r"\blost_control=": "lost_control",
    r"\bselect_runs\b": "files",
    r"\bsketch_effect\b": "sketch",
}

_POOLED = re.compile(
    r"(Runs of \d+ (subject|condition)s are fitted as those of one: (.*?), .*?)\. Fit each"
)


def reworded(text: str, options: argparse.Namespace) -> str:
    """A message, with the options of this command that do what it says in Python."""
    pooled = _POOLED.match(text)
    if pooled and hasattr(options, pooled[2]):
        label = shlex.quote(pooled[3])
        return f"{pooled[1]}. Say --{pooled[2]} {label} to fit one by itself, and so on."
    for part in PYTHON_ONLY:
        text = text.replace(part, "")
    found = [
        "leave it out of FILES" if name == "files" else f"--{name.replace('_', '-')}"
        for pattern, name in OPTION.items()
        if re.search(pattern, text) and hasattr(options, name)
    ]
    if not found:
        return text
    end = "" if text.endswith((".", "?", "!")) else "."
    return f"{text}{end} On the command line: {', '.join(found)}."


def as_option(options: argparse.Namespace, name: str, value: str) -> str:
    """What settles a question, as one types it; as for an argument where there is no option."""
    if not hasattr(options, name):
        name, value = "role", f"{value}={name}"
    if name == "resample":
        return "--resample"
    typed = value if value in ("NAME", "SECONDS") else shlex.quote(value)
    return f"--{name} {typed}"
