"""Figures in files."""

import matplotlib.pyplot as plt
import pytest
from matplotlib.figure import Figure

from skhoid.io.writing import save_figure


@pytest.mark.parametrize(("name", "begin"), [("one.png", b"\x89PNG"), ("one.svg", b"<?xml")])
def test_a_saved_figure_is_whole_and_closed(tmp_path, name, begin):
    figure, _ = plt.subplots()
    path = save_figure(figure, tmp_path / name)
    assert path.read_bytes().startswith(begin)
    assert list(tmp_path.iterdir()) == [path]
    assert not plt.fignum_exists(figure.number)


def test_who_drew_it_is_kept(tmp_path):
    path = save_figure(Figure(), tmp_path / "one.png", metadata={"Software": "skhoid demo"})
    assert b"Software\0skhoid demo" in path.read_bytes()


def test_a_figure_that_cannot_be_drawn_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="doc"):
        save_figure(Figure(), tmp_path / "one.doc")
    assert list(tmp_path.iterdir()) == []


def test_fonts_are_embedded_as_truetype(tmp_path):
    figure, ax = plt.subplots()
    ax.set_title("A title")
    content = save_figure(figure, tmp_path / "one.pdf").read_bytes()
    assert b"/Type0" in content
    assert b"/Type3" not in content
