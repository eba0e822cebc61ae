"""The cells of the tournament can be simulated, and are what they say."""

import numpy as np
import pytest

from skhoid import CompensatoryTask, MonteCarloStudy
from skhoid.lab.studies import TournamentCell, tournament_cells
from skhoid.lab.studies.tournament_conditions import Change, Points, elements, shapes


def test_all_cells_are_there_once():
    cells = tournament_cells()
    assert len({cell.name for cell in cells}) == len(cells) == 94
    families = [cell.family for cell in cells]
    assert [families.count(f) for f in ("condition", "shape", "50 Hz", "element")] == [72, 12, 6, 4]


def test_kinds_are_those_of_the_tasks():
    for cell in tournament_cells(intensities=[0.15], orders=[2]):
        changes = Change.of(cell.task()).times is not None
        assert changes == (cell.kind == "changing"), cell.name


@pytest.mark.slow
def test_every_cell_can_be_simulated_with_its_remnant():
    """P_n of four runs, each of which scatters by some 15 %: within five deviations of the mean."""
    cells = tournament_cells()
    study = MonteCarloStudy(
        lambda data, cell: {"P_n": float(data.record.intensity().mean())},
        [cell.row() for cell in cells],
        4,
        simulation={"run_in": 20.0},
        random_state=0,
    )
    table = study.run()
    assert table["error"].isna().all()
    mean = table.groupby("cell", sort=False)["P_n"].mean().to_numpy()
    wanted = np.array([cell.remnant_intensity for cell in cells])
    np.testing.assert_allclose(mean, wanted, rtol=0.4)


@pytest.mark.parametrize("name", ["K/s²", "K/(s(s+1))"])
def test_elements_are_controlled_well(name):
    condition, _ = elements()[name]
    record = CompensatoryTask.of_condition(condition, run_in=20.0).simulate(1)
    assert record.e.std() < 0.8 * record.f_t.std()


def test_no_shape_is_a_sigmoid():
    """Their K_edot neither rises once and smoothly, nor is it symmetric about its middle."""
    t = np.arange(0, 81.92, 0.01)
    paths = {name: np.asarray(c.operator.K_edot(t)) for name, c in shapes().items()}
    steps = {name: np.diff(path) for name, path in paths.items()}
    assert (steps["relapse"] < -1e-6).any()
    assert np.count_nonzero(np.abs(steps["jump"]) > 1e-9) == 1
    middle = paths["two changes"][(t > 35) & (t < 50)]
    assert np.ptp(middle) < 1e-12
    slope = steps["drift"][(t[1:] > 26) & (t[1:] < 64)]
    np.testing.assert_allclose(slope, slope[0], rtol=1e-6)


def test_weights_hold_outside_their_points():
    weight = Points((1.0, 2.0, 3.0), (0.0, 1.0, 0.5))
    np.testing.assert_allclose(weight([0, 1.5, 2.5, 9]), [0, 0.5, 0.75, 0.5])
    assert weight.changes == (1.0, 3.0)


def test_some_cells_only():
    cells = tournament_cells(conditions=["C4", "relapse", "K/s²"], intensities=[0.15])
    names = {cell.name for cell in cells}
    assert "C4, P_n 0.15, order 1" in names
    assert {"relapse, P_n 0.15", "K/s², P_n 0.15", "C4, P_n 0.15, 50 Hz"} <= names
    assert len(cells) == 4 + 1 + 1 + 1
    other = tournament_cells("small", conditions=["C1"], intensities=[0.1], orders=["nm"])
    assert [(c.remnant_intensity, c.remnant_order) for c in other] == [(0.1, "nm")]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": "huge"}, "size must be one of"),
        ({"conditions": ["C7"]}, "Unknown condition 'C7'; known are C1, .* Did you mean"),
        ({"intensities": [0.0]}, "above 0"),
    ],
)
def test_errors(options, message):
    with pytest.raises(ValueError, match=message):
        tournament_cells(**options)
    with pytest.raises(ValueError, match="kind must be one of"):
        TournamentCell("a", "C1", kind="odd")
