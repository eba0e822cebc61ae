"""Any words after `skhoid`: it is done, or one line says what is wrong, and nothing is written."""

import argparse
import contextlib
import io
import json
import os
import shutil
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import joblib
import pytest
from hypothesis import strategies as st
from support.fuzzing import RAW, fuzz

from skhoid import ARXRegressor, make_tracking_runs, write_runs
from skhoid.lab.cli import main, make_parsers

COMMANDS = next(
    action.choices
    for action in make_parsers()[0]._actions
    if isinstance(action, argparse._SubParsersAction)
)
FILES = ["runs.csv", "runs.parquet", "one.csv", "empty.csv", "text.csv", "head.csv", "bytes.mat"]
PATHS = [*FILES, "folder", "missing.csv", "*.csv", "*", "no*.csv", "[", "", "new", "new.csv", "a/b"]
WORDS = ["e", "u", "x", "f_t", "time", "run", "none", "all", "C1", "0", "1", "2", "0.01", "0.02"]
HOSTILE = [
    "-1", "0.5", "nan", "inf", "-inf", "1e308", "1e-300", "1e9", "", " ", "x=", "=", "e=deg",
    "time=ms", "time=min", "a=b=c", "e=e", "u=e", "é", "\udcff", "--", "-", "%s", "{0}", "[",
    "bias", "dead_zone", "tremor", "1/(s(s+1))", "1/0", "__import__('os')", "1 2", "\n", "\x00",
]  # fmt: skip
FOR_LONG = {  # what each command takes so that it does not work for minutes
    "compare": ["model.joblib", "runs.csv", "--time", "time", "--run", "run"],
    "diagnose": [
        "runs.csv",
        "--time",
        "time",
        "--run",
        "run",
        "--effects",
        "bias",
        "--no-pictures",
    ],
    "identify": ["runs.csv", "--time", "time", "--run", "run", "--no-pictures"],
    "report": ["runs.csv", "--time", "time", "--run", "run", "--effects", "none"],
    "simulate": ["--runs", "1", "--rate", "50", "--out", "new.csv"],
    "study": ["list"],
    "completion": ["bash"],
}
SLOW = {"diagnose", "report"}  # seconds each, so that they are drawn less often
UNSAFE = {"--debug", "--jobs", "--help", "-h"}  # a traceback is what --debug is for


@st.composite
def command_lines(draw):
    """A command that would work, and some options with values of their own."""
    often = [name for name in FOR_LONG if name not in SLOW]
    name = draw(st.sampled_from(often * 3 + sorted(SLOW)))
    words = list(FOR_LONG[name]) if draw(st.integers(0, 9)) else []
    if name == "diagnose" and not words:
        words = ["missing.csv"]
    if name == "report" and not words:
        words = ["missing.csv"]
    if name in ("identify", "compare", "diagnose", "report") and not draw(st.integers(0, 3)):
        words[len(words) > 1 and name == "compare" :][:1] = [draw(st.sampled_from(PATHS))]
        if words:
            words[int(name == "compare" and len(words) > 1)] = draw(st.sampled_from(PATHS))
    options = [a for a in COMMANDS[name]._actions if not UNSAFE & {*a.option_strings}]
    for action in draw(st.lists(st.sampled_from(options), max_size=4)):
        if action.option_strings:
            words.append(draw(st.sampled_from(action.option_strings)))
        if action.nargs == 0:
            continue
        values = [*WORDS, *HOSTILE, *PATHS]
        if action.choices is not None:
            values = [*map(str, action.choices), "x"]
        for _ in range(draw(st.integers(1, 2 if action.nargs else 1))):
            words.append(draw(st.sampled_from(values)))
    return [name, *words]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Recordings, and files that are none."""
    folder = tmp_path_factory.mktemp("command_line")
    X, y = make_tracking_runs(
        n_runs=3, sampling_rate=50, duration=20.48, remnant_intensity=0.1, random_state=0,
        channels=["e", "x", "f_t"],
    )  # fmt: skip
    for name in ("runs.csv", "runs.parquet"):
        write_runs(X, y, folder / name)
    X.loc[0].assign(u=y.loc[0]).to_csv(folder / "one.csv")
    (folder / "empty.csv").write_text("")
    (folder / "head.csv").write_text("time,e,u\n")
    (folder / "text.csv").write_text("time,e,u\n0,a,b\n1,c,d\n")
    (folder / "bytes.mat").write_bytes(bytes(range(256)))
    (folder / "folder").mkdir()
    joblib.dump(ARXRegressor(nk=15, inputs=["e"]).fit(X, y), folder / "model.joblib")
    return folder


def content(folder):
    """All files of a folder, and their bytes."""
    return {p: p.read_bytes() if p.is_file() else None for p in Path(folder).rglob("*")}


def run(words):
    """Exit code, stdout and stderr of a command."""
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("default")
        try:
            code = main(words)
        except SystemExit as stop:
            code = stop.code
    return code, out.getvalue(), err.getvalue()


@fuzz(batch=5, words=command_lines())
def test_words(folder, words):
    before_here = os.getcwd()
    with TemporaryDirectory() as here:
        shutil.copytree(folder, here, dirs_exist_ok=True)
        os.chdir(here)
        try:
            before = content(here)
            code, out, err = run(words)
            after = content(here)
        finally:
            os.chdir(before_here)
    assert code in (0, 2), err
    assert "Traceback" not in err
    if code == 0:
        assert out or "--json" not in words
        if "--json" in words and "--help" not in words:
            json.loads(out)
        return
    lines = err.strip().splitlines()
    assert "error:" in lines[-1] or any(": error:" in line for line in lines), err
    assert sum(": error:" in line for line in lines) == 1, err
    assert not RAW.search(err), err
    assert after == before, set(after) ^ set(before)
