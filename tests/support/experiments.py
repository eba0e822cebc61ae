"""One small experiment with known signals, and the files that different labs make of it."""

import json
import struct
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

PEOPLE, CONDITIONS, RUNS = ("S1", "S2"), ("gain", "lead"), ("1", "2", "10")
DT = 0.01
UNITS = {"e": "deg"}


def experiment(*, lengths=(60, 45, 52), people=PEOPLE, conditions=CONDITIONS, runs=RUNS):
    """X and y whose runs differ in length; values have few digits, so that text holds them."""
    rng = np.random.default_rng(0)
    frames, outputs, keys = [], [], []
    for k, key in enumerate((s, c, r) for s in people for c in conditions for r in runs):
        n = lengths[k % len(lengths)]
        values = np.round(np.cumsum(rng.standard_normal((2, n)), axis=1), 3)
        time = pd.Index(np.round(np.arange(n) * DT, 6), name="time")
        frames.append(pd.DataFrame({"e": values[0]}, index=time))
        outputs.append(pd.Series(values[1], index=time, name="u"))
        keys.append(key)
    names = ["subject", "condition", "run"]
    X, y = pd.concat(frames, keys=keys, names=names), pd.concat(outputs, keys=keys, names=names)
    return X, y


def people_in_the_loop(people=4, conditions=("C1", "C2"), runs=2, *, seconds=20, seed=0):
    """People who hold an integrator on a target by a gain and a delay, with remnant, at 50 Hz."""
    rng = np.random.default_rng(seed)
    step, n = 0.02, round(seconds / 0.02)
    time = np.arange(n) * step
    waves = 2 * np.pi * np.array([1, 3, 5, 8, 13, 21]) / 20
    frames, keys = [], []
    for s in range(people):
        for c, condition in enumerate(conditions):
            gain, late = (1.2 + 0.5 * c) * np.exp(0.15 * rng.standard_normal()), rng.integers(8, 14)
            for run in range(1, runs + 1):
                phases = rng.uniform(0, 2 * np.pi, waves.size)
                f_t = (np.sin(np.outer(time, waves) + phases) / np.arange(1, 7)).sum(axis=1)
                remnant = lfilter([0.1], [1, -0.9], rng.standard_normal(n))
                # e = f_t - x, x = integral of u, u = gain e (some samples late) + remnant
                loop = np.zeros(late + 2)
                loop[:2] = 1, -1
                loop[late + 1] += gain * step
                e = lfilter([1, -1], loop, f_t) - lfilter([0, step], loop, remnant)
                u = lfilter([*np.zeros(late), gain], [1], e) + remnant
                frames.append(np.column_stack([e, f_t - e, f_t, u]))
                keys.append((f"S{s + 1}", condition, run))
    index = pd.MultiIndex.from_tuples(
        [(*key, t) for key in keys for t in np.round(time, 6)],
        names=["subject", "condition", "run", "time"],
    )
    table = pd.DataFrame(np.concatenate(frames), index=index, columns=["e", "x", "f_t", "u"])
    return table[["e", "x", "f_t"]], table["u"]


def each_run(X, y):
    """Label (subject, condition, run) and columns t, e, u of each run."""
    rows = pd.DataFrame({"t": X.index.get_level_values("time"), "e": X["e"].array, "u": y.array})
    for key, places in X.groupby(level=[0, 1, 2], sort=False).indices.items():
        yield key, rows.iloc[places].reset_index(drop=True)


def padded(X, y, name):
    """A channel as an array samples x runs x conditions x people, NaN behind short runs."""
    table = X["e"] if name == "e" else y
    keys = [list(dict.fromkeys(X.index.get_level_values(k))) for k in range(3)]
    longest = max(len(run) for _, run in each_run(X, y))
    array = np.full((longest, len(keys[2]), len(keys[1]), len(keys[0])), np.nan)
    for (s, c, r), rows in table.groupby(level=[0, 1, 2], sort=False):
        at = keys[2].index(r), keys[1].index(c), keys[0].index(s)
        array[(slice(len(rows)), *at)] = rows.to_numpy()
    return array


def write_bids_motion(folder, X, y, *, latency=False):
    """Motion tables of BIDS, with the files beside them."""
    for (s, c, r), run in each_run(X, y):
        stem = f"sub-{s}_task-{c}_run-{r}"
        place = Path(folder) / f"sub-{s}" / "motion"
        place.mkdir(parents=True, exist_ok=True)
        names = ["t", "e", "u"] if latency else ["e", "u"]
        run[names].to_csv(place / f"{stem}_motion.tsv", sep="\t", header=False, index=False)
        kinds = {"t": "LATENCY", "e": "POS", "u": "MISC"}
        pd.DataFrame(
            {
                "name": names,
                "component": "x",
                "type": [kinds[name] for name in names],
                "tracked_point": "n/a",
                "units": [{"t": "s", "e": "deg", "u": "n/a"}[name] for name in names],
            }
        ).to_csv(place / f"{stem}_channels.tsv", sep="\t", index=False)
        about = {"SamplingFrequency": 1 / DT, "TaskName": c}
        (place / f"{stem}_motion.json").write_text(json.dumps(about))
    (Path(folder) / "participants.tsv").write_text("participant_id\nsub-S1\n")
    (Path(folder) / "dataset_description.json").write_text("{}")


def write_xdf(path, streams, *, clock_offsets=None):
    """Write an XDF file: a dict of stream name to (time, values, labels, units, rate).

    The clock of each stream is ``clock_offsets[name]`` seconds behind that of the recording.
    Text values make a stream of markers.
    """
    with Path(path).open("wb") as file:
        file.write(b"XDF:")
        _chunk(file, 1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
        for number, (name, (time, values, labels, units, rate)) in enumerate(streams.items(), 1):
            text = isinstance(values[0], str)
            values = values if text else np.asarray(values, dtype="<f8").reshape(len(time), -1)
            width = 1 if text else values.shape[1]
            described = "".join(
                f"<channel><label>{label}</label><unit>{unit}</unit></channel>"
                for label, unit in zip(labels, units, strict=True)
            )
            head = (
                f"<info><name>{name}</name><type>x</type><channel_count>{width}</channel_count>"
                f"<nominal_srate>{rate}</nominal_srate>"
                f"<channel_format>{'string' if text else 'double64'}</channel_format>"
                f"<desc><channels>{described}</channels></desc></info>"
            )
            _chunk(file, 2, head.encode(), number)
            behind = (clock_offsets or {}).get(name, 0.0)
            for at in (time[0], time[-1]):
                _chunk(file, 4, struct.pack("<dd", at - behind, behind), number)
            rows = b"".join(
                b"\x08"
                + struct.pack("<d", at - behind)
                + (_text(value) if text else np.asarray(value, dtype="<f8").tobytes())
                for at, value in zip(time, values, strict=True)
            )
            _chunk(file, 3, b"\x04" + struct.pack("<I", len(time)) + rows, number)
            _chunk(file, 6, b"<info><sample_count>%d</sample_count></info>" % len(time), number)


def _text(value):
    data = value.encode()
    return b"\x01" + struct.pack("<B", len(data)) + data


def _chunk(file, tag, content, stream=None):
    body = struct.pack("<H", tag) + (b"" if stream is None else struct.pack("<I", stream)) + content
    file.write(b"\x04" + struct.pack("<I", len(body)) + body)
