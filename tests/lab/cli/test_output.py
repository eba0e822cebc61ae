"""Text and tables that fit the terminal."""

import pytest

from skhoid.lab.cli.output import print_table, say_next, wrapped

LINE = (
    "  with bias and dead zone: held-out VAF 80.8 -> 89.1 %, RMSE 0.03194 -> 0.02412 deg, "
    "p < 1e-6; K_e = 0.04 ± 0.01 deg/deg, over 4 runs"
)
WHOLE = ("80.8 -> 89.1 %", "0.03194 -> 0.02412 deg", "p < 1e-6", "K_e = 0.04 ± 0.01 deg/deg")


@pytest.mark.parametrize("columns", range(40, 101, 7))
def test_numbers_stay_with_their_units(columns):
    text = wrapped(LINE, columns)
    assert max(map(len, text.splitlines())) <= columns
    assert all(part in text for part in WHOLE)
    assert " ".join(text.split()) == LINE.strip()


def test_a_table_fits_and_keeps_its_numbers_whole(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    rows = [["an effect of many words (in a form)", "+1.00", "limit = 0.10 ± 0.02 deg"]]
    headings = ["effect", "gain", "its numbers"]
    print_table("Title", headings, rows, left=["effect", "its numbers"], folded=["effect"])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 60
    assert "limit = 0.10 ± 0.02 deg" in printed


def test_commands_are_never_broken(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    command = "skhoid diagnose " + "a long name.csv " * 6
    say_next([(command, "why")])
    assert command in capsys.readouterr().out
