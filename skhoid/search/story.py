"""``Story``: comparison and search in one, reported line by line as they run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ..diagnosis.comparison import Comparison, compare
from ..effects.actuator import Backlash, Quantised, RateLimit, Saturation
from ..effects.base import Effect
from ..effects.input_maps import AsymmetricGain, CubicGain, DeadZone
from ..effects.offsets import Bias, Drift
from ..effects.paths import Feedforward, OutputFeedback
from ..effects.time_variation import GainDrift, TimeVaryingGain
from ..preprocessing.base import as_fitted
from ..recordings.loss_of_control import sentences_of
from ..regression import units_of
from ..runs import output_name, read_layout
from ..summaries import Estimate, counted
from .effect_search import EffectSearchCV
from .explanations import HOW_TO_GO_ON, in_loop_text, stand_ins_sentence, unexplained_by
from .left_out import control_of, without_output

# Sizes that matter in condition C1, in which error and output have about 0.6 and 0.08 deg rms.
HIDDEN: dict[str, Effect] = {
    e.name: e
    for e in (
        DeadZone(width=0.3),
        AsymmetricGain(asymmetry=0.3),
        CubicGain(hardening=0.5),
        Saturation(limit=0.1),
        RateLimit(limit=0.2),
        Backlash(gap=0.03),
        Quantised(step=0.1, offset=0.0),
        Bias(level=0.05),
        Drift(rate=0.002),
        GainDrift(rate=-0.008),
        TimeVaryingGain(K_e_change=-0.4, K_edot_change=0.8, rate=2.0, time=40.0),
        Feedforward(gain=0.5, delay=0.2),
        OutputFeedback(gain=0.03, rate_gain=0.02, delay=0.2),
    )
}
SHOWN = 3  # candidates of a step, and findings of the comparison


class Story:
    """Measured runs, baseline, comparison, search, and what is left, in plain sentences.

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
        """Run the steps, and report each result as soon as it is known.

        Yields
        ------
        line : str
        """
        estimator = self.search.estimator
        self._lost = control_of(estimator, self.X, self.search.lost_control, self.search.domain)
        self._kept = without_output(self.y, self._lost)
        self.baseline_ = clone(estimator).fit(self.X, self._kept)
        yield from self._measured()
        yield from self._of_baseline()
        try:
            self.comparison_: Comparison | None = compare(self.baseline_, self.X, self._kept)
        except ValueError as error:
            self.comparison_ = None
            yield f"Comparison: not possible ({error})"
        else:
            yield from self._compared(self.comparison_)
        self.search_ = clone(self.search).fit(self.X, self.y)
        yield from self._searched()
        yield from self._ended()

    def _measured(self) -> Iterator[str]:
        model = self.baseline_
        told = as_fitted(model)
        layout = read_layout(self.X, dt=told.dt, run=told.run)
        n_runs = len(layout.labels)
        yield (
            f"Measured: {counted(n_runs, 'run')}, {layout.n_rows} rows at {1 / layout.dt:.6g} Hz, "
            f"{layout.n_rows * layout.dt:.0f} s in all"
        )
        inputs = [str(name) for name in model.inputs_]
        others = [str(c) for c in getattr(self.X, "columns", []) if str(c) not in inputs]
        text = f"  input {', '.join(map(self._named, inputs))}, output {self._named(self._output)}"
        if others:
            text += f"; channels that effects may use: {', '.join(map(self._named, others))}"
        yield text
        for sentence in sentences_of(self._lost.table):
            yield f"  {sentence}"

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

    def _of_baseline(self) -> Iterator[str]:
        yield ""
        yield f"Baseline: {type(self.baseline_).__name__}, linear and constant in time"
        yield f"  {parameter_line(self.baseline_)}"

    def _compared(self, found: Comparison) -> Iterator[str]:
        yield ""
        yield "Comparison with the measurement"
        about = ""
        if found.mean_dominates:
            about = f" about zero, which is mostly the mean: {found.vaf_about_mean:.1f} % about it"
        yield f"  the free run explains a VAF of {found.vaf:.1f} %{about}"
        if np.isfinite(found.noise_ceiling):
            low, high = found.noise_ceiling_interval
            gap = max(found.explainable_gap, 0.0)
            left = f"{gap:.1f} points are left" if gap else "nothing is left, within its error"
            yield (
                f"  a model of these channels can reach {found.noise_ceiling:.1f} % ({low:.1f} to "
                f"{high:.1f}), judged by this model: {left}"
            )
            yield f"  the ceiling is {found.ceiling_note}"
        else:
            why = found.ceiling_note.removeprefix("none: ")
            yield f"  how much of the rest is remnant is not known: {why}"
        for note in found.notes:
            yield f"  note: {note}"
        for finding in found.findings[:SHOWN]:
            cost = f" ({finding.severity:.1f} points)" if np.isfinite(finding.severity) else ""
            # That nothing is missing is for the search to say.
            title = "No test exceeds chance" if finding.name == "none" else finding.title
            yield f"  - {title}{cost}"

    def _searched(self) -> Iterator[str]:
        search, path = self.search_, self.search_.error_path_
        unit = self.units.get(self._output)
        position = 0
        for number, candidates in search.ranking_.groupby("step"):
            tried = candidates[candidates["status"] != "does not apply"]
            refused = len(candidates) - len(tried)
            verb = "does" if refused == 1 else "do"
            aside = f" ({refused} {verb} not apply)" if refused else ""
            yield ""
            yield (
                f"Search, step {number}: {counted(len(tried), 'effect')} tried{aside}, judged on "
                "rows held out of the fit"
            )
            if number == 1:  # of a likelihood fit, above, it can be lower
                yield (
                    f"  without any, the best free run has a VAF of {path['vaf'].iloc[0]:.1f} %"
                    f"{in_loop_text(path.iloc[0])}"
                )
            tried = tried[tried["delta_bic"].notna()]
            for _, row in tried.head(SHOWN).iterrows():
                yield f"  {candidate_line(row)}"
            for name in path["effect"].iloc[position + 1 :]:
                added = candidates[(candidates["status"] == "added") & (_bare(name, candidates))]
                if added.empty:
                    continue
                position += 1
                yield from _added(added.iloc[0], name, path.iloc[position - 1 : position + 1], unit)
                break
            else:
                if len(tried):
                    best = tried.iloc[0]
                    yield (
                        "  none pays: likelihood, held-out VAF and the closed loop, where it is "
                        f"known, must say so; {best['effect']}: {best['reason']}"
                    )

    def _ended(self) -> Iterator[str]:
        search = self.search_
        yield ""
        yield f"Verdict: {search.verdict_}"
        path = search.error_path_
        if len(path) > 1:
            vaf, in_loop = path["vaf"], in_loop_text(path.iloc[0], path.iloc[-1])
            yield f"  held-out VAF {vaf.iloc[0]:.1f} -> {vaf.iloc[-1]:.1f} %{in_loop}"
            yield f"  {parameter_line(search.best_estimator_)}"
        if search.stand_ins_:
            yield f"  {stand_ins_sentence(search.stand_ins_)}"
        if search.best_effects_[-1:] == ["unknown"]:
            ends = unexplained_by(search.verdict_, search.ranking_, as_fitted(search).max_effects)
            yield f"  what {ends}:"
            for _, row in search.unexplained_.iterrows():
                yield f"  - {row['description']} ({row['where']}): {row['points']:.1f} points"
        if search.verdict_ in HOW_TO_GO_ON:
            yield f"  {HOW_TO_GO_ON[search.verdict_]}"
        last = search.error_path_.iloc[-1]
        if np.isfinite(last["ceiling"]):
            gap = max(last["explainable_gap"], 0.0)
            yield f"  left to explain: {gap:.1f} points of VAF; the rest is remnant"
        else:
            why = f": {search.ceiling_note_}" if search.ceiling_note_ else ""
            yield f"  how much is left to explain is not known for held-out rows{why}"
        for sentence in (*search.experiments_, *search.notes_):
            yield f"  note: {sentence}"

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
            "verdict": search.verdict_,
            "explainable_gap": search.explainable_gap_,
            "parameters": _records(search.best_estimator_.parameters_.reset_index()),
            "unexplained": _records(search.unexplained_),
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


def parameter_line(model: Any) -> str:
    """All estimated parameters of a model with standard errors and units, in one line."""
    parts = []
    for name, row in model.parameters_.iterrows():
        if "__" in str(name) and row["sd"] == 0.0:  # given by the choice of a form
            continue
        parts.append(f"{name} = {Estimate.of(row)}")
    return ", ".join(parts)


def candidate_line(row: pd.Series) -> str:
    """One candidate of a ranking: what it reaches, how likely it is, and its parameters."""
    form = f" ({row['form']})" if row["form"] else ""
    text = (
        f"{row['rank']}. {row['effect']}{form}: VAF {row['vaf_after']:.2f} %, evidence "
        f"{row['delta_bic']:+.0f}"
    )
    if np.isfinite(row["gain_loop"]):
        text += f", in the closed loop {row['gain_loop']:+.2f} points"
    return f"{text}; {row['parameters']}" if row["parameters"] else text


def _bare(name: str, candidates: pd.DataFrame) -> pd.Series:
    """Which candidates an entry of the error path may be: ``dead_zone-2`` is a dead_zone."""
    return candidates["effect"] == name.split("-")[0]


def _added(row: pd.Series, name: str, path: pd.DataFrame, unit: str | None) -> Iterator[str]:
    before, after = path.iloc[0], path.iloc[1]
    unit = f" {unit}" if unit else ""
    yield f"  {name} is added: VAF {before['vaf']:.1f} -> {after['vaf']:.1f} %, RMSE " + (
        f"{before['rmse']:.4g} -> {after['rmse']:.4g}{unit}, p = {row['p_value']:.1g}"
        f"{in_loop_text(before, after)}"
    )
    yield f"  {row['words']}"
    if row["confused_with"]:
        yield f"  as good on these runs: {', '.join(row['confused_with'])}"


def _records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    return [
        {key: v.item() if isinstance(v, np.generic) else v for key, v in record.items()}
        for record in frame.to_dict("records")
    ]
