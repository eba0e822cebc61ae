"""Whether an installed skhoid works: names, models, recordings, report, command line.

    python tools/smoke_test.py

It needs nothing but skhoid itself, and leaves no files.
"""

import json
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import skhoid

MODULES = (
    "arx diagnosis effects exceptions human interpret io lab lab.experiment lab.report lab.studies "
    "model plotting preprocessing recordings runs search simulation testing tracking"
)


def command(*words: str) -> str:
    program = [sys.executable, "-m", "skhoid", *words]
    return subprocess.run(program, check=True, capture_output=True, text=True).stdout


for name in ("skhoid", *(f"skhoid.{part}" for part in MODULES.split())):
    module = import_module(name)
    missing = [public for public in getattr(module, "__all__", []) if not hasattr(module, public)]
    assert not missing, (name, missing)

X, y = skhoid.make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
model = skhoid.ARXRegressor(nk=15).fit(X, y)
assert model.predict(X).shape == y.shape
vaf = skhoid.vaf_score(y, model.predict(X))
assert 80 < vaf < 100, vaf
assert len(skhoid.load_human_tracking()[0]) > 0
assert len(skhoid.load_bicycle_rider()[0]) > 0

with tempfile.TemporaryDirectory() as folder:
    page = skhoid.report(model, X, y, effects=None).save(Path(folder) / "report.html")
    assert page.stat().st_size > 100_000
    skhoid.write_runs(X, y, f"{folder}/runs.csv")
    words = ("identify", f"{folder}/runs.csv", "--input", "e", "--output", "u", "--time", "time")
    found = json.loads(command(*words, "--run", "run", "--json"))
    assert found, found

print(
    f"skhoid {skhoid.__version__} works: VAF {vaf:.1f} %, report of {page.name}, {len(found)} keys"
)
