"""What an effect may ask of the model to which it is added."""

from dataclasses import replace

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Effects, ErrorScan, Intermittent
from skhoid.effects.catalogue import CLASSES
from skhoid.model.cores import ARXCore, OperatorCore
from skhoid.model.fitting import Criterion
from skhoid.model.jumps import Scan
from skhoid.model.model import fit_core
from skhoid.model.simulator import Simulator
from skhoid.testing import synthetic_record

OPERATOR = [0.8, 0.3, 9.0, 0.4, 0.2]
ARX = [-1.6, 0.68, 0.05, 0.03]
CORES = {"operator": (OperatorCore(None), OPERATOR), "arx": (ARXCore(2, 2, 10), ARX)}
MEMBERS = [n for n in vars(ErrorScan) if n == "__call__" or n[0] != "_"]


def parent_of(kind):
    """A core fitted to runs of one whose command was held between events."""
    core, own = CORES[kind]
    record = core.add_to_record(synthetic_record())
    hidden = Effects.of(Intermittent(trigger="event", hold_time=0.2, threshold=0.3))
    record = replace(record, y=Simulator(core, hidden, record).run(np.array(own)) * record.known)
    return fit_core(core, record, Criterion(record), np.array([own]))


@pytest.fixture(scope="module")
def operator():
    return parent_of("operator")


def scan_of(parent, effect, **options):
    criterion = Criterion(parent.simulator.record)
    return Scan(parent, effect.name, effect, criterion, **options)


def test_effects_ask_nothing_else(operator):
    """Each effect of the catalogue scans beside a model of which it sees the protocol alone."""

    class Only:
        def __init__(self, scan):
            self._scan = scan

        def __getattr__(self, name):
            if name not in MEMBERS:
                raise AttributeError(name)
            return getattr(self._scan, name)

        def __call__(self, *args):
            return self._scan(*args)

    record = operator.simulator.record
    for effect in (c() for c in CLASSES):
        kind = operator.simulator.core.kind
        for variant in [] if effect.refusal(record, kind) else effect.variants(record)[:1]:
            scan = Only(scan_of(operator, variant))
            first = {p.name: p.starts[0] for p in variant.parameters}
            for start in variant.scanned(scan, record) + variant.scanned_beside(scan, first):
                assert {name for name in start if name[0] != "+"} == first.keys()
                assert np.isfinite(list(start.values())).all()


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "hold", "threshold"), [(1, 0.36, 0.045), (2, 0.6, 0.035)])
def test_long_holds_between_events_are_found(seed, hold, threshold):
    hidden = Intermittent(trigger="event", hold_time=hold, threshold=threshold)
    X, y = make_tracking_runs(
        "C1",
        4,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        sampling_rate=50.0,
        duration=60.0,
        effects=hidden,
        random_state=seed,
    )
    model = OperatorRegressor(effects=[Intermittent(trigger="event")]).fit(X, y)
    found = model.parameters_["value"]
    assert found["intermittent__hold_time"] == pytest.approx(hold, rel=0.04)
    assert found["intermittent__threshold"] == pytest.approx(threshold, rel=0.15)
