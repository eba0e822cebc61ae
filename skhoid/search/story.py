"""``Story``: comparison and search in one, reported as they run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..diagnosis.comparison import Comparison, compare
from ..effects.registry import title_of, titles_of
from ..preprocessing.base import as_fitted
from ..recordings.loss_of_control import notes_of_lost
from ..regression import units_of
from ..runs import output_name, read_layout
from ..text import Estimate, counted, p_text
from .effect_search import EffectSearchCV
from .explanations import HOW_TO_GO_ON, in_loop_text, stand_ins_sentence, unexplained_by
from .left_out import control_of, without_output
from .shape import NAMES_AHEAD, Shape, told_shape
from .statuses import Status

SHOWN = 3  # candidates of a step, and findings of the comparison


class StoryTable(str):
    """A table of a story, as plain text and in its parts.

    ``ids`` are the names of its rows as one types them; a cell may have several lines.
    """

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    kind: str
    ids: Sequence[str]

    def __new__(
        cls,
        caption: str,
        headings: Sequence[str],
        rows: Sequence[Sequence[str]],
        kind: str,
        ids: Sequence[str],
    ) -> StoryTable:
        cells = [[cell.replace("\n", ", ") for cell in row] for row in (headings, *rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in cells
        ]
        table = super().__new__(cls, "\n".join([caption, *(f"  {line}" for line in lines)]))
        table.caption, table.headings, table.rows = caption, headings, rows
        table.kind, table.ids = kind, ids
        return table


class Story:
    """Measured runs, search, verdict and its limits, in plain sentences and tables.

    Parameters
    ----------
    search : EffectSearchCV
        The search, unfitted.
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels, one row per sample.
    y : Series or array of shape (n_rows,)
        Measured output.

    Attributes
    ----------
    baseline_ : estimator
        The model without effects.
    comparison_ : Comparison or None
        The baseline against the measurement; None where the runs are too short for it.
    search_ : EffectSearchCV
        The search, fitted.

    Examples
    --------
    >>> from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
    >>> from skhoid.search.story import Story
    >>> from skhoid.effects import Bias
    >>> X, y = make_tracking_runs(
    ...     n_runs=2,
    ...     remnant_intensity=0.05,
    ...     random_state=0,
    ...     sampling_rate=50,
    ...     effects=Bias(level=0.1),
    ... )
    >>> story = Story(EffectSearchCV(OperatorRegressor(), effects=["bias", "drift"]), X, y)
    >>> lines = list(story.tell())
    >>> lines[0]
    'Measured: 2 runs, 8192 rows at 50 Hz, 164 s in all'
    >>> story.search_.best_effects_
    ['bias']
    """

    def __init__(self, search: EffectSearchCV, X: Any, y: Any):
        self.search = search
        self.X = X
        self.y = y

    def tell(self) -> Iterator[str]:
        """Run the steps, and report each result as soon as it is known, the verdict first.

        Yields
        ------
        block : str
            A line, or a table, a :class:`StoryTable`.
        """
        estimator = self.search.estimator
        self._lost = control_of(estimator, self.X, self.search.lost_control, self.search.domain)
        self._kept = without_output(self.y, self._lost)
        self.baseline_ = clone(estimator).fit(self.X, self._kept)
        yield from self._measured()
        yield ("Searching for what a linear model is missing (some 10 to 60 s) ...")
        why_not = ""
        try:
            self.comparison_: Comparison | None = compare(self.baseline_, self.X, self._kept)
        except ValueError as error:
            self.comparison_, why_not = None, str(error)
        self.search_ = clone(self.search).fit(self.X, self.y)
        yield from self._ended()
        yield from self._searched()
        yield ""
        yield f"Without effects: {type(self.baseline_).__name__}, linear and constant in time"
        if self.comparison_ is None:
            yield f"  comparison with the measurement: not possible ({why_not})"
        else:
            yield from self._compared(self.comparison_)

    def _measured(self) -> Iterator[str]:
        model = self.baseline_
        told = as_fitted(model)
        layout = read_layout(self.X, dt=told.dt, run=told.run)
        n_runs = len(layout.labels)
        inputs = [str(name) for name in model.inputs_]
        others = [str(c) for c in getattr(self.X, "columns", []) if str(c) not in inputs]
        yield (
            f"Measured: {counted(n_runs, 'run')}, {layout.n_rows} rows at {1 / layout.dt:.6g} Hz, "
            f"{layout.n_rows * layout.dt:.0f} s in all"
        )
        text = f"  input {', '.join(map(self._named, inputs))}, output {self._named(self._output)}"
        if others:
            text += f"; channels that effects may use: {', '.join(map(self._named, others))}"
        yield text
        for note in notes_of_lost(self._lost.table):
            yield f"  {note.with_hint}"

    @property
    def _output(self) -> str:
        return output_name(self.y)

    @property
    def units(self) -> dict[str, str]:
        """Units of the channels, as far as they are known."""
        return {**units_of(self.X), **units_of(self.y)}

    def _named(self, channel: str) -> str:
        unit = self.units.get(channel)
        return f"{channel} ({unit})" if unit else channel

    def _compared(self, found: Comparison) -> Iterator[str]:
        about = ""
        if found.mean_dominates:
            about = f" about zero, which is mostly the mean: {found.vaf_about_mean:.1f} % about it"
        held_out = self.search_.error_path_["vaf"].iloc[0]
        yield (
            f"  simulated on the rows of its fit it has a VAF of {found.vaf:.1f} %{about}; held "
            f"out it has {held_out:.1f} %, where it is fitted for simulation and not by likelihood"
        )
        if np.isfinite(found.noise_ceiling):
            low, high = found.noise_ceiling_interval
            gap = max(found.explainable_gap, 0.0)
            left = f"{gap:.1f} points are left" if gap else "nothing is left, within its error"
            yield (
                f"  noise ceiling on these rows, judged by this model: "
                f"{found.noise_ceiling:.1f} % ({low:.1f} to {high:.1f}): {left}"
            )
            yield f"  the ceiling is {found.ceiling_note}"
        else:
            yield f"  how much of the rest is remnant is not known: {found.ceiling_note}"
        for finding in found.findings[:SHOWN]:
            cost = f" ({finding.severity:.1f} points)" if np.isfinite(finding.severity) else ""
            # That nothing is missing is for the search to say.
            title = "No test exceeds chance" if finding.name == "none" else finding.title
            yield f"  - {title}{cost}"
        for note in found.notes:
            yield f"  note: {note}"

    def _searched(self) -> Iterator[str]:
        search, path = self.search_, self.search_.error_path_
        unit = self.units.get(self._output)
        position = 0
        for number, candidates in search.ranking_.groupby("step"):
            tried = candidates[candidates["status"] != Status.REFUSED]
            refused = len(candidates) - len(tried)
            verb = "does" if refused == 1 else "do"
            aside = f" ({refused} {verb} not apply)" if refused else ""
            yield ""
            head = f"Search, step {number}: {counted(len(tried), 'effect')} tried{aside}"
            head += ", judged on held-out rows"
            tried = tried[tried["delta_bic"].notna()]
            if tried.empty:
                yield head
            else:
                yield candidates_table(tried.head(SHOWN), head)
                if number == 1:
                    yield (
                        "  gain: points of VAF on held-out rows, by which the search ranks; the "
                        "VAF below is of models fitted anew without the rows that they simulate. "
                        "ΔBIC: BIC without the effect minus BIC with it."
                    )
            for name in path["effect"].iloc[position + 1 :]:
                added = candidates[
                    (candidates["status"] == Status.ADDED) & (_bare(name, candidates))
                ]
                if added.empty:
                    continue
                position += 1
                yield from _added(added.iloc[0], path.iloc[: position + 1], unit)
                break
            else:
                if len(tried):
                    best = tried.iloc[0]
                    yield f"  No effect is added. {title_of(best['effect'])}: {best['reason']}"

    def _ended(self) -> Iterator[str]:
        search = self.search_
        path, model = search.error_path_, search.best_estimator_
        names = list(path["effect"].iloc[1:])
        yield ""
        found = f": {titles_of(names)}" if names and not search.verdict_.leaves_unknown else ""
        yield f"Verdict: {search.verdict_}{found}"
        last = path.iloc[-1]
        if len(path) > 1:
            vaf, in_loop = path["vaf"], in_loop_text(path.iloc[0], last)
            yield f"  held-out VAF {vaf.iloc[0]:.1f} -> {vaf.iloc[-1]:.1f} %{in_loop}"
        else:
            yield f"  held-out VAF {last['vaf']:.1f} %{in_loop_text(last)}"
        if np.isfinite(last["ceiling"]):
            gap = max(last["explainable_gap"], 0.0)
            left = (
                f"left to explain: {gap:.1f} points" if gap >= 0.05 else "nothing left to explain"
            )
            yield f"  {left}, as any model could reach {last['ceiling']:.1f} % (the noise ceiling)"
        else:
            why = f": {search.ceiling_note_}" if search.ceiling_note_ else ""
            yield f"  how much is left to explain is not known for held-out rows{why}"
        if search.stand_ins_:
            yield f"  {stand_ins_sentence(search.stand_ins_)}"
        if search.verdict_.leaves_unknown:
            ends = unexplained_by(search.verdict_, search.ranking_, as_fitted(search).max_effects)
            yield f"  what {ends}:"
            for _, row in search.unexplained_.iterrows():
                yield f"  - {row['description']} ({row['where']}): {row['points']:.1f} points"
        yield from (f"  {line}" for line in told_shape(search.best_effects_, search.shape_))
        if search.verdict_ in HOW_TO_GO_ON:
            yield f"  {HOW_TO_GO_ON[search.verdict_]}"
        for sentence in (*search.experiments_, *search.notes_):
            yield f"  note: {sentence}"
        if search.shape_ is not None:
            yield ""
            yield from shape_tables(search.shape_)
        yield ""
        yield parameters_table(model, names)

    def as_dict(self) -> dict[str, Any]:
        """The same as numbers and names, for JSON.

        Returns
        -------
        found : dict
        """
        search, compared = self.search_, self.comparison_
        layout = read_layout(self.X, dt=self.baseline_.dt, run=self.baseline_.run)
        return {
            "n_runs": len(layout.labels),
            "n_rows": layout.n_rows,
            "dt_s": layout.dt,
            "inputs": [str(name) for name in self.baseline_.inputs_],
            "output": self._output,
            "units": self.units,
            "baseline": _records(self.baseline_.parameters_.reset_index()),
            "comparison": None if compared is None else comparison_dict(compared),
            "ranking": _records(search.ranking_),
            "error_path": _records(search.error_path_.reset_index()),
            "best_effects": search.best_effects_,
            "stand_ins": search.stand_ins_,
            "verdict": str(search.verdict_),
            "explainable_gap": search.explainable_gap_,
            "parameters": _records(search.best_estimator_.parameters_.reset_index()),
            "unexplained": _records(search.unexplained_),
            "shape": None if search.shape_ is None else search.shape_.as_dict(),
            "ceiling_note": search.ceiling_note_,
            "experiments": search.experiments_,
            "left_out": _records(search.left_out_),
            "notes": search.notes_,
        }


def comparison_dict(found: Comparison) -> dict[str, Any]:
    """The figures of a comparison, for JSON."""
    return {
        "vaf": found.vaf,
        "noise_ceiling": found.noise_ceiling,
        "noise_ceiling_interval": list(found.noise_ceiling_interval),
        "explainable_gap": found.explainable_gap,
        "findings": [finding.name for finding in found.findings],
    }


def parameters_table(model: Any, effects: Sequence[str] = ()) -> StoryTable:
    """The estimated parameters of a model, those of its effects under their human names."""
    rows = []
    for name, row in model.parameters_.iterrows():
        effect, _, own = str(name).partition("__")
        if own and row["sd"] == 0.0:  # given by the choice of a form
            continue
        found = Estimate.of(row)
        called = f"{title_of(effect)}: {own}" if own else str(name)
        error = found.sd if found.known else ""
        rows.append((str(name), called, found.value, error, found.unit, found.remark.strip(" ()")))
    headings = ["parameter", "value", "±", "unit", ""]
    shown = [list(row[1:]) for row in rows]
    if not any(row[-1] for row in shown):
        headings, shown = headings[:-1], [row[:-1] for row in shown]
    beside = f" of the model with {titles_of(effects)}" if len(effects) else ""
    title = f"Parameters{beside}, ± one standard error"
    return StoryTable(title, headings, shown, "parameters", [row[0] for row in rows])


def candidates_table(candidates: pd.DataFrame, title: str) -> StoryTable:
    """The best candidates of a step: what each gains, how likely it is, and its numbers."""
    in_loop = candidates["gain_loop"].notna().any()
    headings = ["effect", "gain", "ΔBIC", "its numbers"]
    if in_loop:
        headings.insert(3, "in the loop")
    rows = []
    for _, row in candidates.iterrows():
        form = f" ({row['form']})" if row["form"] else ""
        numbers = "\n".join(re.split(r", (?=\w+ = )", row["parameters"] or ""))
        cells = [f"{row['rank']}. {title_of(row['effect'])}{form}"]
        cells.append(f"{row['vaf_gain']:+.2f}")
        cells.append(f"{row['delta_bic']:+.0f}")
        if in_loop:
            known = np.isfinite(row["gain_loop"])
            cells.append(f"{row['gain_loop']:+.2f}" if known else "")
        rows.append([*cells, numbers])
    return StoryTable(title, headings, rows, "candidates", list(candidates["effect"]))


def shape_tables(shape: Shape) -> Iterator[StoryTable]:
    """The curve of what has no name at a few points, and the effects whose curves are nearest."""
    curve, nearest = shape.curve_table(), shape.nearest_table()
    yield StoryTable("Curve of what has no name", curve.header, curve.rows, "shape", [])
    if len(nearest.rows):
        headings = ["effect", "distance", "band", "its numbers"]
        rows = [[*row[:-1], row[-1].replace(", ", "\n")] for row in nearest.rows]
        ids = [str(name) for name in shape.nearest.index]
        yield StoryTable(NAMES_AHEAD.rstrip(":"), headings, rows, "nearest", ids)


def _bare(name: str, candidates: pd.DataFrame) -> pd.Series:
    """Which candidates an entry of the error path may be: ``dead_zone-2`` is a dead_zone."""
    return candidates["effect"] == name.split("-")[0]


def _added(row: pd.Series, path: pd.DataFrame, unit: str | None) -> Iterator[str]:
    before, after = path.iloc[-2], path.iloc[-1]
    unit = f" {unit}" if unit else ""
    yield (
        f"  with {titles_of(path['effect'].iloc[1:])}: held-out VAF {before['vaf']:.1f} -> "
        f"{after['vaf']:.1f} %, RMSE {before['rmse']:.4g} -> {after['rmse']:.4g}{unit}, "
        f"{p_text(row['p_value'])}{in_loop_text(before, after)}"
    )
    yield f"  {row['words']}"
    if row["confused_with"]:
        yield f"  as good on these runs: {titles_of(row['confused_with'])}"


def _records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    return [
        {key: v.item() if isinstance(v, np.generic) else v for key, v in record.items()}
        for record in frame.to_dict("records")
    ]
