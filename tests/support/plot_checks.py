"""What every picture must do."""

import itertools

from skhoid.plotting import PALETTE

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY = PALETTE


def covers_nothing(display):
    """Whether legends lie outside the panels, and words neither overlap nor leave the page."""
    figure = display.figure_
    figure.canvas.draw()
    legends = [*figure.legends, *(p.get_legend() for p in figure.axes if p.get_legend())]
    for legend, panel in itertools.product(legends, figure.axes):
        assert not legend.get_window_extent().overlaps(panel.get_window_extent())
    words = [text for legend in legends for text in legend.get_texts()]
    for panel in figure.axes:
        words += [panel.xaxis.label, panel.yaxis.label, panel.title, *panel.texts]
        for axis in (panel.xaxis, panel.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = axis.get_major_ticks()
            words += [t.label1 for t in ticks if low <= t.get_loc() <= high]
    boxes = [w.get_window_extent() for w in words if w.get_visible() and w.get_text()]
    for box in boxes:
        assert figure.bbox.x0 <= box.x0
        assert box.x1 <= figure.bbox.x1
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)
