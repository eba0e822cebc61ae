"""X, y and the model of what was chosen."""

import pytest

from skhoid.lab.workbench.columns import Choices, look, read, search_settings


@pytest.fixture
def recorded(runs_file):
    return read([runs_file], look([runs_file], Choices()), Choices())


def test_the_search_is_what_was_chosen():
    assert search_settings(Choices()) == {"lost_control": "leave_out"}
    chosen = Choices(display="pursuit", effects=["bias"], controlled_element="1/(s(s+1))")
    settings = search_settings(chosen)
    assert settings["effects"] == ["bias"]
    assert settings["display"] == "pursuit"
    assert "s" in str(settings["controlled_element"])
    both = search_settings(Choices(controlled_element="1.5 0.2"))["controlled_element"]
    assert (both.K_c, both.omega_b) == (1.5, 0.2)


def test_the_start_of_runs_and_means_are_taken_off(runs_file):
    choices = Choices(run_in=2.0, remove_means=True)
    recorded = read([runs_file], look([runs_file], choices), choices)
    assert recorded.y.mean() == pytest.approx(0.0, abs=1e-12)
    assert any("RunInTrimmer" in line for line in recorded.source)


def test_an_irregular_clock_is_brought_onto_a_grid(runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table["time"] += [0.004 * (row % 3) for row in range(len(table))]
    path = tmp_path / "a.csv"
    table.to_csv(path, index=False)
    choices = Choices(resample=True, dt=0.02)
    recorded = read([path], look([path], choices), choices)
    names = {}
    exec("\n".join(["from skhoid import resample_runs", *recorded.source]), names)
    assert names["X"].equals(recorded.X)
    assert names["y"].equals(recorded.y)


def test_one_of_several_people(runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table.insert(0, "subject", ["AB"[row >= 1024] for row in range(len(table))])
    path = tmp_path / "a.csv"
    table.to_csv(path, index=False)
    choices = Choices(subject="B")
    recorded = read([path], look([path], choices), choices)
    assert recorded.words.startswith("2 runs, 2048 rows")
    everyone = read([path], look([path], Choices()), Choices())
    assert everyone.words.startswith("3 runs of 2 people, 3072 rows")
    with pytest.raises(ValueError, match="no subject 'C' in the files, only 'A', 'B'"):
        read([path], look([path], Choices()), Choices(subject="C"))
