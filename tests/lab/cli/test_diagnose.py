"""The command ``skhoid diagnose``: what has no name, as an effect of your own."""

import importlib.util
import sys
from pathlib import Path

import pytest

from skhoid import make_tracking_runs, write_runs
from skhoid.effects import DeadZone
from skhoid.lab.cli import main
from skhoid.testing import check_effect


@pytest.fixture
def gap_file(tmp_path):
    """Runs of an operator that does not see small errors."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=40.96,
        sampling_rate=50,
        remnant_intensity=0.05,
        effects=DeadZone(width=0.6),
        random_state=0,
    )
    path = tmp_path / "runs.csv"
    write_runs(X, y, path)
    return str(path)


@pytest.mark.slow
def test_a_shape_is_written_as_an_effect(capsys, gap_file):
    words = ["diagnose", gap_file, "--effects", "bias", "--no-pictures"]
    assert main([*words, "--sketch", "small_errors.py"]) == 0
    printed = capsys.readouterr().out
    assert "Effect of your own: small_errors.py" in printed
    assert "--sketch my_effect.py" not in printed  # it is done
    spec = importlib.util.spec_from_file_location("small_errors", "small_errors.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["small_errors"] = module
    spec.loader.exec_module(module)
    check_effect(module.SmallErrors())
    assert main(words) == 0
    assert "--effects bias --no-pictures --sketch my_effect.py" in " ".join(
        capsys.readouterr().out.split()
    )


@pytest.mark.slow
def test_without_a_shape_nothing_is_written(capsys, biased_file):
    words = ["diagnose", *biased_file, "--effects", "bias", "drift", "--no-pictures"]
    assert main([*words, "--sketch", "mine.py"]) == 0
    assert "note: --sketch: There is no shape to sketch: what is missing has a name, bias." in (
        capsys.readouterr().err
    )
    assert not Path("mine.py").exists()


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("mine.txt", "--sketch writes a Python file, such as my_effect.py; got mine.txt."),
        ("dead_zone.py", "'dead_zone' is in the catalogue of skhoid already"),
        ("my effect.py", "use a word of letters, digits and single underscores"),
        ("there/is/none.py", "The folder there/is of there/is/none.py does not exist."),
        ("kept.py", "kept.py exists; choose another name, or --overwrite."),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_search(capsys, file, message):
    Path("kept.py").write_text("precious")
    assert main(["diagnose", "no-such-file.csv", "--sketch", file]) == 2
    assert message in capsys.readouterr().err
    assert Path("kept.py").read_text() == "precious"
