"""Order of the pages of the gallery, and what their pictures show in words."""

import re
from typing import Any

import matplotlib.pyplot as plt
from sphinx_gallery.scrapers import matplotlib_scraper
from sphinx_gallery.sorting import NumberOfCodeLinesSortKey

FIRST = ("plot_hidden_effect.py", "plot_real_effects.py", "plot_report.py", "plot_free_run.py")


class PageOrder(NumberOfCodeLinesSortKey):
    """The story and what belongs to it, then the shortest page first."""

    def __call__(self, filename: Any) -> tuple[int, int]:
        name = str(filename)
        return FIRST.index(name) if name in FIRST else len(FIRST), super().__call__(filename)


def pictures(*of_block: Any) -> str:
    """The pictures of a block; what axes show joins titles in the alternative text."""
    for number in plt.get_fignums():
        figure = plt.figure(number)
        if not figure.get_suptitle():
            panels = figure.axes
            shown = [_joined(panel.get_ylabel() for panel in panels)]
            shown.append(_joined(panel.get_xlabel() for panel in panels))
            text = figure.suptitle(" over ".join(filter(None, shown)))
            text.set(visible=False, in_layout=False)
    return matplotlib_scraper(*of_block)


def _joined(labels: Any) -> str:
    plain = (re.sub(r"[$\\{}]", "", label).replace("\n", " ") for label in labels)
    return "; ".join(dict.fromkeys(filter(None, plain)))
