"""What is sent to the component, and the envelope in which it travels.

A page that cannot compute gets all subsets of the effects found, or one comparison. Rows are
thinned, and runs left out, only where the page would become too large; it says so.

The envelope is JSON with the arrays behind it. 4 bytes (little-endian): length of the header; the
header as JSON, with the value and where its arrays are; zeros up to a multiple of 8; the arrays.
``static/wire.js`` reads it.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections.abc import Mapping, Sequence
from itertools import chain, combinations
from typing import Any

import numpy as np

from ... import Comparison, EffectSearchCV
from ...effects import Effects
from ...model import GreyBox
from ...runs import RunLayout, read_layout, run_name
from .exploration import ACTIONS, OPENS_ON, Exploration
from .linear import has_linear_part, round_numbers
from .models import History, own_values
from .script import plain

MOST_SUBSETS_OF = 4  # effects; of more only those that a search went through
MOST_VALUES = 600_000  # in a page
LEAST_RATE = 25.0  # Hz, to which rows are thinned at most
SHOWN_CHANNELS = 4
ALIGNED = 8  # bytes
LEVELS = 65_533  # of a compact array, in which one more stands for NaN
MISSING = -32_768
LITTLE = "<"


def payload_of(
    search: EffectSearchCV | None, comparison: Comparison | None, X: Any, y: Any
) -> dict[str, Any] | None:
    """What a page shows of every subset of the effects that a search found on X and y.

    Where it cannot, what it shows of a comparison, if there is one.
    """
    if search is None or not isinstance(search.best_estimator_, GreyBox):
        return None if comparison is None else payload_of_comparison(comparison)
    fitted = [search.baseline_, search.best_estimator_]
    exploration = Exploration(search.estimator, X, y, search=search, fitted=fitted).at_result()
    return payload_in_report(exploration, comparison)


def payload_in_report(
    exploration: Exploration, comparison: Comparison | None = None
) -> dict[str, Any]:
    """The same of an exploration, without what the page around it says."""
    measured = None if comparison is None else comparison.by_frequency
    payload = payload_of_exploration(exploration, exploration.found.before.names, measured)
    for state in payload["states"].values():
        state |= {"verdict": "", "verdict_kind": "", "limits": []}
    payload["view"]["title"] = ""
    return payload


def payload_of_exploration(
    exploration: Exploration, kept: Sequence[str] = (), by_frequency: Any = None
) -> dict[str, Any]:
    """The same of what an exploration has now, and of what its search found beside.

    Effects that are ``kept`` are in every subset. ``by_frequency`` is that of a comparison; None
    takes what the exploration has found.
    """
    here, runs = exploration.here, exploration.runs
    measured = exploration.figures.measured(here) if by_frequency is None else by_frequency
    shows_linear = has_linear_part(exploration.estimator)
    offered = exploration.with_found()
    names = [name for name in offered.names if name not in kept]
    states: dict[str, Any] = {}
    predictions: dict[str, np.ndarray] = {}
    for chosen in _subsets(names):
        effects = Effects([(n, e) for n, e in offered if n in kept or n in chosen])
        moved = own_values(here.moved, effects)
        position = here.with_changes("", effects=effects, moved=moved)
        state = exploration.state_at(History(position))
        ready = {e.name for n, e in offered if n not in effects.names}
        state["cards"] = [card for card in state["cards"] if card["id"] in ready]
        state |= {"ceiling_pending": False, "findings": [], "search": None}
        key = ",".join(sorted(chosen))
        states[key] = {**state, "to_add": [], "models": []}
        if shows_linear:
            linear = exploration.linear_of({0: position}, measured)
            states[key]["linear"] = round_numbers(linear)
        predictions[key] = exploration.models.prediction(position)
    view = exploration.view()
    start = ",".join(sorted(n for n in here.effects.names if n not in kept))
    view |= {
        "can": dict.fromkeys(ACTIONS, False) | {"change": len(names) > 0, "linear": shows_linear},
        "state": states[start],
    }
    channels = {str(n): runs.frame.iloc[:, i].to_numpy(float) for i, n in enumerate(runs.frame)}
    traces = _Traces(runs.layout, runs.measured, runs.scored, channels, predictions)
    return traces.payload(view, start, states)


def payload_of_comparison(found: Comparison) -> dict[str, Any]:
    """The traces of a comparison, with its figures."""
    table = found.traces
    layout = read_layout(table, fallback_dt=found.dt)
    known = ("measured", "predicted", "residual", "one_step", "scored")
    channels = {str(n): table[n].to_numpy(float) for n in table if n not in known}
    vaf = [None if np.isnan(v) else float(v) for v in found.by_run["vaf"]]
    note = found.ceiling_note
    state = {
        "revision": 0,
        "uses": [""] * len(layout.labels),  # which rows were fitted is not known
        "effects": [],
        "model": [],
        "stair": [{"title": found.model_name, "vaf": found.vaf, "rmse": found.rmse, "held": None}],
        "ceiling": _ceiling(found) if np.isfinite(found.noise_ceiling) else None,
        "ceiling_pending": False,
        "vaf": {"train": found.vaf, "hold": None},
        "run_vaf": vaf,
        "settled": True,
        "impossible": None,
        "undo": None,
        "redo": None,
        "cards": [],
        "cards_of": "",
        "verdict": "",
        "verdict_kind": "",
        "findings": [{"what": f.title, "why": f.meaning} for f in found.findings],
        "limits": [],
        "to_add": [],
        "models": [],
        "search": None,
        "structure": None,
        "preparation": None,
    }
    view = {
        "title": f"{found.model_name} against measured {found.output}",
        "output": {"name": found.output, "unit": found.unit},
        "dt": found.dt,
        "settling": 0.0,
        "can": dict.fromkeys(ACTIONS, False),
        "channels": [{"name": name, "role": name, "unit": None} for name in channels],
        "people": [],
        "runs": [
            {"label": run_name(plain(label)), "n": int(n), "person": None}
            for label, n in zip(layout.labels, np.diff(layout.run_starts), strict=True)
        ],
        "shown": 0,
        "opens_on": OPENS_ON,
        "note": None if np.isfinite(found.noise_ceiling) else note,
        "state": state,
    }
    measured, scored = table["measured"].to_numpy(float), table["scored"].to_numpy(bool)
    predictions = {"": table["predicted"].to_numpy(float)}
    return _Traces(layout, measured, scored, channels, predictions).payload(view, "", {"": state})


def _ceiling(found: Comparison) -> dict[str, Any]:
    return {"vaf": found.noise_ceiling, "note": found.ceiling_note}


def _subsets(names: list[str]) -> list[tuple[str, ...]]:
    if len(names) > MOST_SUBSETS_OF:
        return [tuple(names[:n]) for n in range(len(names) + 1)]
    sizes = range(len(names) + 1)
    return list(chain.from_iterable(combinations(names, n) for n in sizes))


class _Traces:
    """Signals of runs, as many of them as a page may hold."""

    def __init__(
        self,
        layout: RunLayout,
        measured: np.ndarray,
        scored: np.ndarray,
        channels: Mapping[str, np.ndarray],
        predictions: Mapping[str, np.ndarray],
    ):
        self.layout, self.measured, self.scored = layout, measured, scored
        self.channels = dict(list(channels.items())[:SHOWN_CHANNELS])
        self.predictions = predictions
        per_row = 1 + len(self.channels) + len(predictions)
        slowest = max(1, int(1 / (LEAST_RATE * layout.dt) + 1e-6))
        asked = -(-layout.n_rows * per_row // MOST_VALUES)
        self.every = min(asked, slowest)
        n_runs = len(layout.labels)
        rows = layout.n_rows // self.every
        fit = max(1, int(n_runs * MOST_VALUES / max(rows * per_row, 1)))
        kept = np.unique(np.linspace(0, n_runs - 1, min(fit, n_runs)).astype(int))
        self.kept = {int(run) for run in kept}

    @property
    def note(self) -> str | None:
        n_runs = len(self.layout.labels)
        if self.every == 1 and len(self.kept) == n_runs:
            return None
        which = "all runs" if len(self.kept) == n_runs else f"{len(self.kept)} of {n_runs} runs"
        rows = "Every row" if self.every == 1 else f"One row in {self.every}"
        return f"{rows} of {which} is in this page; figures of whole runs are of all rows."

    def payload(self, view: dict[str, Any], start: str, states: Any) -> dict[str, Any]:
        notes = [note for note in (view["note"], self.note) if note]
        more = {"note": " ".join(notes) or None, "shown": min(self.kept)}
        view = {**view, **more}
        view["dt"] = self.layout.dt * self.every
        traces = [self._of_run(run) for run in range(len(self.layout.labels))]
        return {"view": view, "start": start, "states": states, "traces": traces}

    def _of_run(self, run: int) -> dict[str, Any]:
        a, b = self.layout.run_starts[run : run + 2].tolist()
        rows = slice(a, b, self.every)
        about = {"t0": float(self.layout.time[a]), "dt": self.layout.dt * self.every}
        if run not in self.kept:
            return {**about, "measured": None, "scored": None, "channels": None, "simulated": None}
        return {
            **about,
            "measured": self.measured[rows],
            "scored": self.scored[rows],
            "channels": {name: values[rows] for name, values in self.channels.items()},
            "simulated": {key: values[rows] for key, values in self.predictions.items()},
        }


# The envelope.


def pack(value: Any, *, compact: bool = False) -> bytes:
    """A value of dicts, lists, numbers, texts and arrays as an envelope.

    Float arrays are ``compact`` as 16-bit numbers, exact to 1/65533 of their range.
    """
    arrays: list[dict[str, Any]] = []
    data = bytearray()

    def plain(item: Any) -> Any:
        if isinstance(item, np.ndarray):
            about, content = _array(item, compact)
            data.extend(b"\0" * (-len(data) % ALIGNED))
            arrays.append({**about, "offset": len(data), "n": item.size})
            data.extend(content)
            return {"$array": len(arrays) - 1}
        if isinstance(item, Mapping):
            return {str(key): plain(one) for key, one in item.items()}
        if isinstance(item, list | tuple):
            return [plain(one) for one in item]
        return _scalar(item)

    header = json.dumps({"value": plain(value), "arrays": arrays}, allow_nan=False).encode()
    begun = len(header).to_bytes(4, "little") + header
    return begun + b"\0" * (-len(begun) % ALIGNED) + bytes(data)


def pack_text(value: Any) -> str:
    """A compact envelope, compressed, as text that may stand in a page."""
    packed = gzip.compress(pack(value, compact=True), mtime=0)
    return base64.b64encode(packed).decode("ascii")


def unpack(envelope: bytes) -> Any:
    """The value of an envelope, its arrays as float64 (marks as uint8)."""
    length = int.from_bytes(envelope[:4], "little")
    header = json.loads(envelope[4 : 4 + length])
    begin = 4 + length + (-(4 + length) % ALIGNED)
    data = memoryview(envelope)[begin:]

    def whole(item: Any) -> Any:
        if isinstance(item, dict):
            if "$array" in item:
                return _values(header["arrays"][item["$array"]], data)
            return {key: whole(one) for key, one in item.items()}
        return [whole(one) for one in item] if isinstance(item, list) else item

    return whole(header["value"])


def _scalar(item: Any) -> Any:
    if isinstance(item, np.generic):
        item = item.item()
    if isinstance(item, float) and not math.isfinite(item):
        return None
    if item is None or isinstance(item, str | int | float | bool):
        return item
    return str(item)


def _array(array: np.ndarray, compact: bool) -> tuple[dict[str, Any], bytes]:
    array = np.ravel(array)
    if array.dtype == bool or array.dtype == np.uint8:
        return {"dtype": "u1"}, array.astype(np.uint8).tobytes()
    values = array.astype(float)
    if not compact:
        return {"dtype": "f8"}, values.astype(f"{LITTLE}f8").tobytes()
    finite = np.isfinite(values)
    low = float(values[finite].min()) if finite.any() else 0.0
    scale = (float(values[finite].max()) - low) / LEVELS if finite.any() else 0.0
    level = np.full(values.size, MISSING)
    level[finite] = np.rint((values[finite] - low) / (scale or 1.0)) + MISSING + 1
    about = {"dtype": "i2", "zero": low - (MISSING + 1) * scale, "scale": scale}
    return about, level.astype(f"{LITTLE}i2").tobytes()


def _values(about: dict[str, Any], data: memoryview) -> np.ndarray:
    kinds: dict[str, Any] = {"u1": np.uint8, "f8": f"{LITTLE}f8", "i2": f"{LITTLE}i2"}
    found = np.frombuffer(data, kinds[about["dtype"]], about["n"], about["offset"])
    if about["dtype"] != "i2":
        return found.copy()
    values = about["zero"] + about["scale"] * found.astype(float)
    values[found == MISSING] = np.nan
    return values
