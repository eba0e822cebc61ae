"""The command ``skhoid completion``, in real shells where there are any."""

import shutil
import subprocess
import sys

import pytest

from skhoid.lab.cli import main

pytest.importorskip("shtab")


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_scripts(capsys, shell):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(word in script for word in ("diagnose", "--table-format", "parquet", "dead_zone"))
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("skhoid di", "diagnose"),
        ("skhoid identify --table-format p", "parquet"),
        ("skhoid demo --out fol", "folder"),
        ("skhoid demo --effect dead", "dead_zone"),
        ("skhoid study fig1", "fig10 fig12 fig13 fig14 fig15"),
        ("skhoid simulate --condition C4 --cond", "--condition"),
    ],
)
def test_bash_completes(capsys, tmp_path, line, expected):
    for name in ("run-1.csv", "run-2.csv"):
        (tmp_path / name).touch()
    (tmp_path / "folder").mkdir()
    assert main(["completion", "bash"]) == 0
    ask = f"""{capsys.readouterr().out}
    COMP_WORDS=({line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
    $(complete -p skhoid | sed 's/.*-F \\([^ ]*\\).*/\\1/') skhoid "${{COMP_WORDS[-1]}}"
    echo "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert sorted(done.stdout.split()) == expected.split()


def test_a_missing_package_is_named(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == 2
    assert capsys.readouterr().err == (
        'skhoid: error: Completion needs the package shtab: pip install "skhoid[completion]"\n'
    )
