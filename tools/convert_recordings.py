"""Convert the recordings in their source format to what ``skhoid.io.datasets`` carries.

Run as ``python tools/convert_recordings.py SOURCE [DESTINATION]``. SOURCE holds the folders
``human_tracking_2d`` (``random_and_phase_size.parquet``) and ``bicycle_rider``
(``run00105.parquet``); reading them needs pyarrow. The same source gives the same bytes.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from skhoid.io.datasets import _RECORDINGS

TICKS_PER_SECOND = 1e7
DESTINATION = Path(__file__).resolve().parents[1] / "skhoid" / "io" / "data"


def convert_human_tracking(source: Path) -> dict[str, np.ndarray]:
    """Store a target once for all recordings that show it: it repeats to the last bit."""
    recordings = pd.read_parquet(source / "human_tracking_2d" / "random_and_phase_size.parquet")
    frames = {label: recordings[recordings["rec"] == k] for k, label in enumerate(_RECORDINGS)}
    arrays = {}
    for label, target in _RECORDINGS.items():
        frame = frames[label]
        time = np.rint(frame["t"].to_numpy() * TICKS_PER_SECOND).astype(np.int64)
        # The steps are all near 16.67 ms, and compress better than the instants.
        arrays[f"{label}/ticks"] = np.diff(time, prepend=0).astype(np.int32)
        for name in ("cursor_x", "cursor_y"):
            arrays[f"{label}/{name}"] = frame[name].to_numpy().astype(np.int16)
        for name in ("target_x", "target_y", "size_s", "phase_f"):
            values = frame[name].to_numpy()
            np.testing.assert_array_equal(values, frames[target][name].to_numpy())
            if label == target and not np.isnan(values).all():
                arrays[f"{label}/{name}"] = values.astype(np.float32)
    return arrays


def convert_bicycle_rider(source: Path) -> dict[str, np.ndarray]:
    """Store every channel in single precision; the time is exactly k / 200 Hz."""
    frame = pd.read_parquet(source / "bicycle_rider" / "run00105.parquet")
    np.testing.assert_array_equal(frame["time"].to_numpy(), np.arange(len(frame)) / 200)
    return {name: frame[name].to_numpy(np.float32) for name in frame.columns if name != "time"}


def main() -> None:
    """Write both archives."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path)
    parser.add_argument("destination", type=Path, nargs="?", default=DESTINATION)
    arguments = parser.parse_args()
    for name, convert in {
        "human_tracking.npz": convert_human_tracking,
        "bicycle_rider.npz": convert_bicycle_rider,
    }.items():
        path = arguments.destination / name
        np.savez_compressed(path, **convert(arguments.source))
        print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
