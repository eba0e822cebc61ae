"""Pages and pictures of the gallery: their order, their words, their size, their thumbnails."""

import re
import textwrap
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from docutils import nodes
from matplotlib.gridspec import GridSpec
from PIL import Image
from sphinx_gallery.scrapers import matplotlib_scraper
from sphinx_gallery.sorting import NumberOfCodeLinesSortKey

FIRST = ("plot_hidden_effect.py", "plot_real_effects.py", "plot_report.py", "plot_free_run.py")
# The picture, and its panel, that stands for an example; the first ones unless said here.
PANELS = {
    "plot_hidden_effect": (4, 0),
    "plot_real_effects": (3, 0),
    "plot_free_run": (1, 3),
    "plot_compare": (2, 0),
    "plot_real_recordings": (2, 0),
    "plot_noise_ceiling": (2, 0),
    "plot_operator_parameters": (1, 1),
    "plot_forgetting": (2, 0),
    "plot_streaming": (1, 1),
    "plot_track_a_change": (3, 1),
    "plot_real_recording": (4, 0),
    "plot_remnant": (2, 0),
    "plot_remnant_bias": (3, 0),
    "plot_dynamics": (1, 1),
    "plot_arx_frequency_response": (2, 0),
    "plot_recommend": (2, 0),
    "plot_people": (2, 7),
    "plot_parameter_paths": (3, 7),
}
THUMBNAIL = 3.2, 2.24  # inches, at which its words can be read on a card


class PageOrder(NumberOfCodeLinesSortKey):
    """The story and what belongs to it, then the shortest page first."""

    def __call__(self, filename: Any) -> tuple[int, int]:
        name = str(filename)
        return FIRST.index(name) if name in FIRST else len(FIRST), super().__call__(filename)


def pictures(block: Any, variables: dict[str, Any], *rest: Any, **options: Any) -> str:
    """The pictures of a block; what axes show joins titles in the alternative text."""
    images = variables["image_path_iterator"]
    number, panel = PANELS.get(Path(variables["src_file"]).stem, (1, 0))
    wanted = number - len(images)
    figures = [plt.figure(number) for number in plt.get_fignums()]
    for figure in figures:
        if not figure.get_suptitle():
            shown = [_joined(axes.get_ylabel() for axes in figure.axes)]
            shown.append(_joined(axes.get_xlabel() for axes in figure.axes))
            text = figure.suptitle(" over ".join(filter(None, shown)))
            text.set(visible=False, in_layout=False)
    page = matplotlib_scraper(block, variables, *rest, **options)  # closes them
    if 0 < wanted <= len(figures):
        _save_panel(figures[wanted - 1], panel, _panel_file(Path(images.image_path.format(1))))
    return page


def show_panels(app: Any) -> None:
    """Put the panels in place of sphinx-gallery's thumbnails, which shrink whole pictures."""
    for file in Path(app.srcdir, "gallery").rglob("panel_*.png"):
        file.with_name("thumb").mkdir(exist_ok=True)
        name = file.name.replace("panel_", "sphx_glr_").replace(".png", "_thumb.png")
        (file.parent / "thumb" / name).write_bytes(file.read_bytes())


def show_sharp(app: Any, document: nodes.document) -> None:
    """Show a picture at the size that its resolution says, from a finer file if there is one."""
    for image in document.findall(nodes.image):
        file = Path(app.env.relfn2path(image["uri"])[1])
        if file.parent.name == "thumb":  # the cards of the gallery have a size of their own
            continue
        fine = file.with_name(f"{file.stem}_2_00x.png")
        if fine.is_file():
            file = fine
            image["uri"] = str(Path(image["uri"]).with_name(fine.name))
        if file.suffix == ".png" and file.is_file() and "width" not in image:
            with Image.open(file) as picture:
                inches = picture.width / picture.info.get("dpi", (100, 100))[0]
            image["width"] = f"{round(100 * inches)}px"


def _panel_file(image: Path) -> Path:
    """sphx_glr_plot_name_001.png -> panel_plot_name.png"""
    return image.with_name(re.sub(r"^sphx_glr_(.*)_\d+\.png$", r"panel_\1.png", image.name))


def _save_panel(figure: Any, number: int, file: Path) -> None:
    """One panel of a picture, alone and drawn small, so that its words are large."""
    shown = figure.axes[number]
    place, whole = shown.get_subplotspec(), GridSpec(1, 1, figure=figure)[0]
    if place is not None:  # inner panels leave their labels to the outer ones
        _take_labels(shown, figure.axes)
    for artist in [child for axes in figure.axes for child in axes.get_children()]:
        if getattr(artist, "colorbar", None):
            artist.colorbar.remove()
    kept = [axes for axes in figure.axes if axes is shown or axes.get_subplotspec() == place]
    for axes in figure.axes:
        axes.set_subplotspec(whole)
        if place is None or axes not in kept:
            axes.set(visible=False, in_layout=False)  # removed, it would be missed by shared axes
    for axes in kept:
        for side in ("left", "center", "right"):
            axes.set_title("", loc=side)
        axes.tick_params(labelbottom=True, labelleft=axes.yaxis.get_ticks_position() != "right")
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_size("small")
        if axes.get_legend():
            axes.get_legend().remove()
        for text in list(axes.texts):
            text.set_in_layout(False)
            if text.get_text().endswith(" outside"):
                text.remove()
        for child in axes.child_axes:  # the same axis in other units
            child.set(visible=False, in_layout=False)
    for artist in [*figure.legends, *figure.texts]:  # room is kept for legends that are hidden
        artist.remove()
    figure.suptitle("")
    for group in figure._align_label_groups.values():  # matplotlib has no public way back
        for axes in figure.axes:
            group.remove(axes)
    figure.set_size_inches(*THUMBNAIL)
    figure.set_layout_engine("constrained")
    figure.canvas.draw()
    _uncrowd(shown)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=200)


def _take_labels(panel: Any, others: list[Any]) -> None:
    """Labels that a panel has not, from those of its column and of its row."""
    place = panel.get_subplotspec()
    placed = [axes for axes in others if axes.get_subplotspec() is not None]
    column = [a for a in placed if a.get_subplotspec().colspan == place.colspan]
    row = [a for a in placed if a.get_subplotspec().rowspan == place.rowspan]
    panel.set_xlabel(panel.get_xlabel() or _last(axes.get_xlabel() for axes in column))
    panel.set_ylabel(panel.get_ylabel() or _last(axes.get_ylabel() for axes in row[::-1]))


def _last(labels: Any) -> str:
    return next(filter(None, reversed(list(labels))), "")


def _uncrowd(panel: Any) -> None:
    """Wrap or thin the names of ticks, and shrink other words, until each has a place."""
    width = panel.get_window_extent().width
    for text in panel.texts:
        room = width / max(text.get_window_extent().width, 1.0)
        if room < 1.0:
            text.set_size(0.96 * room * text.get_size())
    ticks = list(panel.get_xticks())
    names = [label.get_text() for label in panel.get_xticklabels()]
    if any(name.count(" ") for name in names):  # words
        points = 72.0 / panel.figure.dpi
        panel.set_xticks(ticks, names, fontsize="x-small")
        letters = int(points * width / (len(names) * 0.55 * panel.get_xticklabels()[0].get_size()))
        panel.set_xticks(
            ticks, [textwrap.fill(name, max(letters, 1), break_on_hyphens=False) for name in names]
        )
        return
    while len(ticks) > 2 and _overlap(panel.get_xticklabels()):
        ticks, names = ticks[-1::-2][::-1], names[-1::-2][::-1]
        panel.set_xticks(ticks, names)
        panel.figure.canvas.draw()


def _overlap(labels: Any) -> bool:
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    return any(a.x1 + 2 > b.x0 for a, b in pairwise(boxes))


def _joined(labels: Any) -> str:
    plain = (re.sub(r"[$\\{}]", "", label).replace("\n", " ") for label in labels)
    return "; ".join(dict.fromkeys(filter(None, plain)))
