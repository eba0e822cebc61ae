"""A workbench of short runs, and the client that its page would be."""

import warnings

import pytest
from support.workbench import OWN, PORT, Page

from skhoid import make_tracking_runs, write_runs
from skhoid.effects import Bias, DeadZone
from skhoid.lab.explore import Exploration
from skhoid.lab.workbench.bench import Workbench
from skhoid.lab.workbench.columns import Choices
from skhoid.lab.workbench.server import Keys, make_app
from skhoid.lab.workbench.session import SessionFolder

FEW = Choices(effects=["dead_zone", "bias"])


@pytest.fixture(scope="session")
def runs():
    """X and y of three runs of 20 s, with an offset and a dead zone."""
    X, y = make_tracking_runs(
        n_runs=3,
        duration=20.48,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=0,
        effects=DeadZone(width=0.4) + Bias(level=0.1),
    )
    names = {"e": "error", "x": "pitch", "f_t": "target"}
    return X.rename(columns=names), y.rename("stick")


@pytest.fixture(scope="session")
def runs_file(runs, tmp_path_factory):
    """The same in one file whose columns can be guessed."""
    path = tmp_path_factory.mktemp("recorded") / "runs.csv"
    write_runs(*runs, path)
    return path


@pytest.fixture
def judged():
    """Whether noise ceiling and findings are found after each step, which takes long."""
    return False


@pytest.fixture
def begun(tmp_path, monkeypatch, judged):
    """A function that begins a workbench, or opens the session of one again."""
    if not judged:
        monkeypatch.setattr(Exploration, "judge", lambda exploration: None)
    with warnings.catch_warnings():
        # Starlette prefers httpx2 from 1.10 on, and takes httpx, which older ones need.
        warnings.filterwarnings("ignore", "Using `httpx`")
        from starlette.testclient import TestClient

    benches = []

    def begin(*paths, choices=FEW, name="session"):
        folder = SessionFolder(tmp_path / name)
        folder.take()
        bench, keys = Workbench(folder, list(paths), choices), Keys()
        benches.append(bench)
        bench.begin(folder.load())
        client = TestClient(make_app(bench, keys, PORT), base_url=OWN)
        client.get("/", params={"token": keys.token})
        return Page(client, bench, keys)

    yield begin
    for bench in benches:
        bench.close()


@pytest.fixture
def fitted(begun, runs_file):
    """A page on which the model is fitted."""
    page = begun(runs_file)
    page.wait("columns")
    page.post("fit")
    page.wait("bench")
    return page
