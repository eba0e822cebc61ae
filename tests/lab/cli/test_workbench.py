"""The command ``skhoid workbench``, up to the point where it serves."""

import pytest

from skhoid.lab.cli import main


@pytest.fixture
def served(monkeypatch):
    """What would be served."""
    found = []

    def serve(session, kept, paths, choices, **more):
        found.append((session, kept, paths, choices, more))
        session.give_back()

    monkeypatch.setattr("skhoid.lab.workbench.server.serve", serve)
    return found


def test_files_and_what_is_said_of_them(served, biased_file, capsys, tmp_path):
    assert main(["workbench", *biased_file, "--no-browser", "--port", "8765"]) == 0
    session, kept, paths, choices, more = served[0]
    assert session.path == tmp_path / "skhoid-workbench"
    assert kept is None
    assert paths == [tmp_path / "runs.csv"]
    assert choices.named["output"] == "stick"
    assert choices.named["roles"] == {"e [deg]": "e", "angle": "x", "wanted": "f_t"}
    assert choices.named["signals"] is False
    assert more["port"] == 8765
    assert more["browser"] is False
    assert f"skhoid workbench --session {session.path}" in capsys.readouterr().out


def test_nothing_need_be_said(served, run_files):
    assert main(["workbench", *run_files, "--session", "mine", "--effects", "bias"]) == 0
    session, _, paths, choices, more = served[0]
    assert session.path.name == "mine"
    assert len(paths) == 3
    assert choices.named == {}
    assert choices.effects == ["bias"]
    assert more["browser"] is True


def test_preparation_may_be_said(served, run_files):
    assert main(["workbench", *run_files, "--run-in", "3", "--decimate", "2"]) == 0
    choices = served[0][3]
    assert (choices.run_in, choices.decimate) == (3.0, 2)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--port", "0"], "must be"),
        (["--port", "70000"], "must be"),
        (["no-such-file.csv"], "no-such-file.csv"),
        (["--nk", "3"], "--core arx"),
        (["--decimate", "0"], "at least 1"),
        (["--effects", "no_such"], "No effect is called 'no_such'"),
        (["--session", "a.txt"], "is a file; name a folder"),
        (["--unit", "e"], "NAME=UNIT"),
    ],
)
def test_what_is_wrong_is_said(served, words, said, capsys, tmp_path):
    (tmp_path / "a.txt").write_text("")
    try:
        code = main(["workbench", *words])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert said in capsys.readouterr().err
    assert served == []


def test_what_is_not_installed_is_said(served, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "starlette", None)
    assert main(["workbench"]) == 2
    assert 'pip install "skhoid[workbench]"' in capsys.readouterr().err
