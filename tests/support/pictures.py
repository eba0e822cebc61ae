"""Every Display, from the example in its docstring; and what its texts stand on.

Run as a script, it writes all of them as PNG into a folder, to be looked at.
"""

import doctest
import sys
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from skhoid import plotting

DISPLAYS = [name for name in plotting.__all__ if name.endswith("Display")]
KINDS = {  # that the example of a docstring can be drawn as
    "ComparisonDisplay": [
        "overview",
        "ceiling",
        "runs",
        "time",
        "frequency",
        "amplitude",
        "map",
        "correlation",
    ],
    "SearchDisplay": ["path", "steps", "ranking"],
    "GroupMeansDisplay": ["conditions", "forest"],
}
PICTURES = [(name, kind) for name in DISPLAYS for kind in KINDS.get(name, [None])]
COLUMN = {"figure.figsize": (3.4, 2.5)}  # of a journal
STYLES = {
    "screen": {},
    "column": COLUMN,
    "dark": {**mpl.style.library["dark_background"]},
    "dark column": {**mpl.style.library["dark_background"], **COLUMN},
}
TOUCH = 1.0  # points by which boxes may overlap: they hold air above and below the letters


@cache
def example(name):
    """The Display that the example of its docstring makes."""
    cls = getattr(plotting, name)
    (test,) = doctest.DocTestFinder(recurse=False).find(cls, name, globs={})
    names = {}
    for step in test.examples:
        if step.source.strip().startswith(("display.", "list(", "[", "float(", "len(")):
            continue  # what it shows
        exec(compile(step.source, name, "exec"), names)
    plt.close("all")
    return names["display"]


def picture(name, kind):
    """The same, to be drawn as a kind."""
    display = example(name)
    return display if kind is None else replace(display, kind=kind)


def legend_texts(display):
    """Words in the legend of a figure of the Display's own."""
    (legend,) = display.figure_.legends
    return [text.get_text() for text in legend.get_texts()]


def boxes_of(figure):
    """Boxes of the texts and legends that are seen, each with what it says."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    legends = [*figure.legends, *(a.get_legend() for a in figure.axes if a.get_legend())]
    of_legends = {id(text) for legend in legends for text in legend.findobj(Text)}
    hidden = set()
    for axes in figure.findobj(lambda artist: hasattr(artist, "xaxis")):  # secondary ones too
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            shown = set()
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if low - slack <= tick.get_loc() <= high + slack:
                    shown |= {id(tick.label1), id(tick.label2)}
            every = [*axis.majorTicks, *axis.minorTicks]  # some are left over from other limits
            hidden |= {id(text) for tick in every for text in (tick.label1, tick.label2)} - shown
            if not axes.axison or not axes.get_visible():
                hidden |= {id(text) for text in axis.findobj(Text)}
    found = []
    for text in figure.findobj(Text):
        shown = text.get_visible() and text.get_text().strip()
        if shown and id(text) not in of_legends | hidden:
            found.append((text.get_text(), text.get_window_extent(renderer)))
    found += [
        ("legend of " + ", ".join(t.get_text() for t in legend.get_texts()), extent)
        for legend in legends
        if legend.get_visible() and (extent := legend.get_window_extent(renderer))
    ]
    return [(what, box) for what, box in found if box.width > 0]


def faults_of(figure):
    """What overlaps or is cut off in a figure, in words."""
    boxes = boxes_of(figure)
    point = figure.dpi / 72
    whole = figure.bbox.padded(TOUCH * point)
    faults = [
        f"{what!r} is cut off"
        for what, box in boxes
        if not (whole.contains(box.x0, box.y0) and whole.contains(box.x1, box.y1))
    ]
    for (what, box), (other, its_box) in combinations(boxes, 2):
        common = Bbox.intersection(box, its_box)
        if common is not None and min(common.width, common.height) > TOUCH * point:
            faults.append(f"{what!r} overlaps {other!r}")
    for what, box in boxes:
        panels = figure.axes if what.startswith("legend of ") else []
        for axes in panels:
            common = Bbox.intersection(box, axes.get_window_extent())
            if common is not None and min(common.width, common.height) > TOUCH * point:
                faults.append(f"{what!r} lies on a panel")
    return faults


def main(folder, *names):
    for name, kind in PICTURES:
        if names and name not in names:
            continue
        display = picture(name, kind)
        for style, settings in STYLES.items():
            with mpl.rc_context(settings):
                figure = display.plot().figure_
                for fault in faults_of(figure):
                    print(f"{name}, {kind}, {style}: {fault}")
                file = "-".join([name[:-7], *[kind] * (kind is not None), *style.split()])
                figure.savefig(Path(folder) / f"{file}.png", dpi=150)
                plt.close("all")


if __name__ == "__main__":
    main(*sys.argv[1:])
