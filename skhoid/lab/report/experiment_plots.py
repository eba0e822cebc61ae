"""Plots of the page of an experiment, as SVG embedded in its HTML."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..experiment.read import ALL
from .plots import TILE, WIDE, Gallery, Plot, _legend_below, _slanted_if_long

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
        from ...plotting.group_effects import GroupEffectsDisplay

        display = GroupEffectsDisplay(
            prevalence=prevalence,
            members=group.members_,
            people=list(dict.fromkeys(group.people_["subject"])),
            least_prevalence=float(group.least_prevalence),
        )
        return self._display(
            display,
            2,
            "Who has which effect (the darker, the more probable), and the share of people who "
            "have it, with its 95 % interval",
        )

    def people(self, people: Any) -> Plot:
        """VAF of everybody's runs against the ceiling."""
        from ...plotting.people import PeopleDisplay

        display = PeopleDisplay(runs=people.runs, groups=people.groups, outlying=people.outlying)
        return self._display(
            display,
            max(people.groups["subject"].nunique(), 1),
            "How well each person is modelled: VAF of each run and of all runs in one fit, against "
            "the noise ceiling; red names and rings look wrong",
        )

    def _display(self, display: Any, n_panels: int, caption: str) -> Plot:
        """A display with a shape of its own, in a figure that no window shows."""
        from matplotlib.figure import Figure

        with self._drawing():
            wanted = display._wanted()
            rows, columns = wanted.pop("shape", (1, 2))
            size = WIDE[0], wanted.pop("figsize")[1]  # as wide as the page: letters stay small
            figure = Figure(figsize=size, layout="constrained")
            ratios = {"width_ratios": wanted.pop("width_ratios", None)}
            panels = figure.subplots(rows, columns, squeeze=False, gridspec_kw=ratios, **wanted)
            for spare in panels.flat[n_panels:]:
                spare.remove()
            display.plot(panels.flat[:n_panels])
            _legend_below(figure)
            return self._plot(figure, caption)

    def stretch(self, stretch: Stretch, who: str, condition: Any) -> Plot:
        """Measured and simulated output."""
        from ...plotting._axes import with_unit
        from ...plotting._roles import ROLES

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
        from ...plotting.condition_means import ConditionMeansDisplay
        from ...plotting.parameter_forest import ParameterForestDisplay

        n, people = len(result.effects), result.people["subject"].nunique()
        plots = []
        with self._drawing() as new:
            figure = self._beside(n, 1.4 + 0.2 * people)
            ParameterForestDisplay.from_result(result, ax=figure.axes)
            caption = f"{name}: each person with the 95 % interval, and below the mean over people"
            plots.append(replace(self._plot(figure, caption), wide=n > 2))
            if n > 1:
                panel = new(TILE)
                ConditionMeansDisplay.from_result(result, ax=panel.axes[0])
                _slanted_if_long(panel.axes[0])
                _legend_below(panel)
                caption = f"{name}: people (thin) and their mean over conditions"
                plots.append(self._plot(panel, caption))
        return plots

    def _beside(self, n: int, height: float) -> Any:
        """A figure with panels side by side that share both axes."""
        from matplotlib.figure import Figure

        width = TILE[0] if n < 3 else min(1.2 + 2.4 * n, WIDE[0])
        figure = Figure(figsize=(width, height), layout="constrained")
        figure.subplots(1, n, sharex=True, sharey=True)
        return figure
