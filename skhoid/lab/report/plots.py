"""Plots of a report, as SVG embedded in its HTML."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...effects import title_of
from ...search import with_effects
from ..experiment.groups import ALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...diagnosis import Comparison

TILE = (4.2, 3.1)  # inches; a phone shows it at nearly full size, so that its letters stay readable
BAR = (4.2, 1.9)
WIDE = (10.5, 4.2)  # on a phone one scrolls
LINE = 52  # letters across a tile
NAMED = re.compile(r'\bid="|url\(#|xlink:href="#')
SYMBOL = re.compile(r"\$(\w)_\{?(\w+)\}?\$")
STYLE: dict[str, Any] = {
    "font.size": 9.5,
    "svg.fonttype": "none",  # text stays text: it can be searched, and read aloud
    "svg.hashsalt": "skhoid",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.dpi": 100,
    "savefig.dpi": 150,
    "savefig.facecolor": "white",
}


@dataclass(frozen=True)
class Plot:
    """An SVG element with what it shows."""

    svg: str
    caption: str
    wide: bool = False


class Gallery:
    """Makes the plots of one page, whose ids must differ.

    Parameters
    ----------
    names : iterable of str
        Names from the data that plots may show.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._numbers = count(1)
        self._names = list(names)

    def svg(self, figure: Figure, label: str) -> str:
        """The figure as an SVG element that scales with the page."""
        from ...plotting import names_as_they_are

        names_as_they_are(figure, self._names)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        svg = text.getvalue()
        svg = svg[svg.index("<svg") :]
        svg = re.sub(r"<metadata>.*?</metadata>", "", svg, count=1, flags=re.S)
        # Matplotlib's style applies to *, which inside HTML would be the whole page.
        svg = re.sub(r"<style.*?</style>", "", svg, flags=re.S)
        prefix = f"p{next(self._numbers)}-"
        svg = re.sub(r"<[^<>]+>", lambda tag: NAMED.sub(rf"\g<0>{prefix}", tag[0]), svg)
        head, rest = svg.split(">", 1)
        head = re.sub(r'\s(width|height|version|xmlns(:xlink)?)="[^"]*"', "", head)
        return f'{head} role="img" aria-label="{escape(label)}">{rest}'

    def comparison(self, found: Comparison) -> list[Plot]:
        """Where a model fails: one plot for each view."""
        from ...plotting import ComparisonDisplay

        with self._drawing() as new:
            panels = [new(size) for size in (WIDE, TILE, TILE, TILE, BAR)]
            display = ComparisonDisplay.from_comparison(found, ax=[p.axes[0] for p in panels])
            for panel in panels:
                panel.axes[0].set_title("")
                _legend_below(panel)
            traces, time, frequency, amplitude, bar = panels
            channel = _plain(amplitude.axes[0].get_xlabel()) or "the signals"
            runs = new(TILE)
            ComparisonDisplay.from_comparison(found, "runs", ax=runs.axes[0])
            runs.axes[0].set_title("")
            _shorten_labels(runs.axes[0])
            _slanted_if_long(runs.axes[0])
            _legend_below(runs)
            plots = [
                self._plot(
                    bar, "How much is explained, how much a better model could explain, and remnant"
                ),
                self._plot(runs, "Run by run"),
                self._plot(
                    traces, f"Measured and simulated output in run {display.run_}, the worst"
                ),
                self._plot(time, "Where in time: points of VAF lost"),
                self._plot(frequency, "Where in frequency: spectra"),
                self._plot(amplitude, f"Where in amplitude: mean residual over {channel}"),
            ]
            panel = new(TILE)
            ComparisonDisplay.from_comparison(found, "map", ax=panel.axes[0])
            _rasterised(panel)
            _legend_below(panel)
            plots.append(self._plot(panel, "Where in time and frequency: residual power"))
        return plots

    def steps(self, search: Any) -> list[Plot]:
        """Measured against held-out simulation at each step, all in the same window."""
        from ...plotting import SearchDisplay

        with self._drawing() as new:
            place = SearchDisplay.from_estimator(search, "steps", ax=new((4, 4), 2).axes)
            added = search.error_path_["effect"].iloc[1:]
            if not place.lines_:  # nothing could be simulated
                return []
            limits = [panel.get_ylim() for panel in place.axes_]
            plots = []
            for step in range(len(added) + 1):
                shown = [0] if step == 0 else [0, step]
                figure = new(WIDE, 2, sharex=True, height_ratios=[1.6, 1.0])
                panels = figure.axes
                display = SearchDisplay.from_estimator(
                    search, "steps", run=place.run_, window=place.window_, steps=shown, ax=panels
                )
                for panel, limit in zip(panels, limits, strict=True):
                    panel.set_ylim(limit)
                if step:
                    for line in (display.lines_["baseline"], display.residuals_["baseline"]):
                        line.set(color="0.6", lw=1.0, zorder=1)
                panels[0].set_title("")
                _legend_below(figure)
                caption = (
                    f"Run {place.run_}, {place.window_[0]:.4g} to {place.window_[1]:.4g} s: "
                    f"measured and simulated ({with_effects(added[:step])}), by a model that was "
                    "not fitted to these rows"
                )
                plots.append(self._plot(figure, caption))
        return plots

    def shape(self, shape: Any) -> Plot:
        """The curve of what has no name."""
        from ...plotting import EffectDisplay

        with self._drawing() as new:
            figure = new(WIDE)
            EffectDisplay.from_shape(shape, ax=figure.axes[0])
            figure.axes[0].set(title="", ylabel="")
            _legend_below(figure)
            what = shape.y_label[:1].upper() + shape.y_label[1:]
            return self._plot(figure, f"{what}, over {shape.x_label}")

    def effects(self, model: Any, X: Any, y: Any) -> list[Plot]:
        """Each identified effect itself."""
        from ...plotting import EffectDisplay

        plots = []
        with self._drawing() as new:
            for name in model.effects_.names:
                panel = new(TILE)
                display = EffectDisplay.from_estimator(model, name, X, y, ax=panel.axes[0])
                panel.axes[0].set_title("")
                _legend_below(panel)
                caption = f"{title_of(name)}: {display.physics}".rstrip(".")
                caption = caption[:1].upper() + caption[1:]
                plots.append(self._plot(panel, caption))
        return plots

    def channels(self, X: Any, y: Any) -> list[Plot]:
        """The recorded signals over time."""
        from ...plotting import TrackingDisplay

        return self._stacked(
            X.shape[1] + 1,
            lambda axes: TrackingDisplay.from_runs(X, y, ax=axes),
            "Recorded channels over the time in a run",
        )

    def paths(self, model: Any) -> list[Plot]:
        """Parameters over time, of a model that follows the data."""
        from ...plotting import ParametersDisplay

        return self._stacked(
            len(model.parameter_names_),
            lambda axes: ParametersDisplay.from_estimator(model, ax=axes),
            "Parameters over the time in a run",
        )

    def _stacked(self, n: int, draw: Callable[[Any], Any], caption: str) -> list[Plot]:
        """Panels one below the other, over one time."""
        with self._drawing() as new:
            figure = new((WIDE[0], 0.8 + 1.3 * n), n, sharex=True)
            draw(figure.axes)
            for panel in figure.axes:
                if panel is not figure.axes[-1]:
                    panel.set_xlabel("")
                # Beside a low panel there is no room for long names.
                name, letters = panel.get_ylabel(), int(LINE * WIDE[0] / TILE[0])
                panel.set_ylabel("")
                title = textwrap.fill(name, letters)
                panel.set_title(title, loc="left", fontsize="medium", pad=3)
            _legend_below(figure)
            return [self._plot(figure, caption)]

    @contextmanager
    def _drawing(self) -> Iterator[Any]:
        """A maker of figures that no window and no notebook shows."""
        import matplotlib as mpl
        from matplotlib.figure import Figure

        def new(size: tuple[float, float], rows: int = 1, **options: Any) -> Figure:
            ratios = options.pop("height_ratios", None)
            figure = Figure(figsize=size, layout="constrained")
            figure.subplots(rows, gridspec_kw={"height_ratios": ratios}, **options)
            return figure

        style: Any = STYLE
        with mpl.rc_context(style):
            yield new

    def _plot(self, figure: Figure, caption: str) -> Plot:
        return Plot(self.svg(figure, caption), caption, figure.get_figwidth() > TILE[0])


def _plain(label: str) -> str:
    """The same without mathematics."""
    return SYMBOL.sub(r"\1_\2", label)


def _legend_below(figure: Figure) -> None:
    """One legend below the panels, where no data can be."""
    from ...plotting import legend_entries

    entries = legend_entries(figure.axes)
    for panel in figure.axes:
        legend = panel.get_legend()
        if legend is not None:
            legend.remove()
    if not entries:
        return
    letters = LINE * figure.get_figwidth() / TILE[0]
    longest = max(len(label) for label in entries) + 6
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="outside lower center",
        ncols=int(np.clip(letters // longest, 1, len(entries))),
        frameon=False,
        fontsize="medium",
    )


def _shorten_labels(panel: Axes) -> None:
    """Shorten labels that only say which runs these are, as the page says it."""
    artists: list[Any] = [*panel.get_children(), *panel.containers]
    for drawn in artists:
        label = str(drawn.get_label())
        if "validation" in label:
            label = label.replace("validation runs", "all runs")
            drawn.set_label(label.replace("validation", "run"))


def _slanted_if_long(panel: Axes) -> None:
    """Names below the axis that would run into each other."""
    letters = sum(len(label.get_text()) + 2 for label in panel.get_xticklabels())
    if letters > LINE:
        for label in panel.get_xticklabels():
            label.set(rotation=30, ha="right", rotation_mode="anchor")


def _rasterised(figure: Figure) -> None:
    """A map as an image: as shapes it would be most of the page."""
    for panel in figure.axes:
        for drawn in panel.collections:
            if drawn.get_array() is not None:
                drawn.set_rasterized(True)


SMALL = (4.2, 1.9)  # inches
MOST_POINTS = 240  # of a line: a page holds one for each person and condition


class Stretch(NamedTuple):
    """Measured and simulated output in a part of a run."""

    time: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    unit: str
    run: str
    how: str


class ExperimentGallery(Gallery):
    """Makes the plots of the page of an experiment."""

    def group_effects(self, group: Any, prevalence: Any) -> Plot:
        """Who has which effect, and the prevalences of those to be shown."""
        from ...plotting import GroupEffectsDisplay

        display = GroupEffectsDisplay(
            prevalence=prevalence,
            members=group.members_,
            people=list(dict.fromkeys(group.people_["subject"])),
            least_prevalence=float(group.least_prevalence),
        )
        return self._display(
            display,
            "Who has which effect (the darker, the more probable), and the share of people who "
            "have it, with its 95 % interval",
        )

    def people(self, people: Any) -> Plot:
        """VAF of everybody's runs against the ceiling."""
        from ...plotting import PeopleDisplay

        display = PeopleDisplay(result=people)
        return self._display(
            display,
            "How well each person is modelled: VAF of each run and of all runs in one fit, against "
            "the noise ceiling; red names and rings look wrong",
        )

    def _display(self, display: Any, caption: str) -> Plot:
        """A display with a shape of its own, in a figure that no window shows."""
        from matplotlib.figure import Figure

        with self._drawing():
            # As wide as the page: letters stay small.
            figure = Figure(figsize=WIDE, layout="constrained")
            return self._plot(display.plot(figure).figure_, caption)

    def stretch(self, stretch: Stretch, who: str, condition: Any) -> Plot:
        """Measured and simulated output."""
        from ...plotting import ROLES, with_unit

        with self._drawing():
            from matplotlib.figure import Figure

            figure = Figure(figsize=SMALL)  # a layout would take most of the time of a page
            panel = figure.add_axes((0.165, 0.28, 0.815, 0.68))
            every = -(-stretch.time.size // MOST_POINTS)
            for role in ("measured", "simulated"):
                values = getattr(stretch, role)
                panel.plot(
                    stretch.time[::every],
                    values[::every],
                    label=ROLES[role].word,
                    **ROLES[role].style(1.1),
                )
            panel.set_xlabel("time, s", loc="left")
            panel.set_ylabel(with_unit("output", stretch.unit))
            panel.margins(x=0)
            place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, -0.02), "ncols": 2}
            figure.legend(frameon=False, **place)
            where = "" if condition == ALL else f"{condition}, "
            caption = ", ".join([who] * bool(who) + [f"{where}run {stretch.run}, {stretch.how}"])
            return self._plot(figure, caption)

    def parameter(self, result: Any, name: str) -> list[Plot]:
        """Everybody's estimates, and the means of conditions."""
        from matplotlib.figure import Figure

        from ...plotting import GroupMeansDisplay

        n, people = len(result.effects), result.people["subject"].nunique()
        plots = []
        with self._drawing() as new:
            width = TILE[0] if n < 3 else min(1.2 + 2.4 * n, WIDE[0])
            figure = Figure(figsize=(width, 1.4 + 0.2 * people), layout="constrained")
            figure.subplots(1, n, sharex=True, sharey=True)
            GroupMeansDisplay.from_result(result, "forest", ax=figure.axes)
            caption = f"{name}: each person with the 95 % interval, and below the mean over people"
            plots.append(self._plot(figure, caption))
            if n > 1:
                panel = new(TILE)
                GroupMeansDisplay.from_result(result, ax=panel.axes[0])
                _slanted_if_long(panel.axes[0])
                _legend_below(panel)
                caption = f"{name}: people (thin) and their mean over conditions"
                plots.append(self._plot(panel, caption))
        return plots
