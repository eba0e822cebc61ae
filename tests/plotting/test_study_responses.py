import numpy as np
import pandas as pd
import pytest
from support.plot_checks import covers_nothing

from skhoid import FrequencyResponse, HumanOperator
from skhoid.plotting import StudyResponseDisplay

pytestmark = pytest.mark.slow

OMEGA = np.array([0.23, 0.38, 0.61, 1.0, 1.69, 2.61, 4.07, 6.6, 10.66, 17.56])
METHODS = ("fc", "batch", "recursive")
TRUE = HumanOperator().frequency_response
N = 12


def responses(intensities=(0.15,), methods=METHODS, condition="C1", n=N):
    """The truth with complex errors; ARX models state half of them."""
    rng = np.random.default_rng(0)
    parts = []
    for P_n in intensities:
        for method in methods:
            sd = P_n * (0.5 if method == "fc" else 0.1)
            for i in range(n):
                error = rng.normal(size=(2, OMEGA.size))
                H = TRUE(OMEGA) * (1 + sd * (error[0] + 1j * error[1]))
                known = np.nan if method == "fc" else 0.5 * sd
                run = {
                    "condition": condition,
                    "remnant_intensity": P_n,
                    "replication": i,
                    "method": method,
                    "omega": OMEGA,
                    "H_real": H.real,
                    "H_imag": H.imag,
                    "magnitude_sd": known * np.abs(H),
                    "phase_sd": known,
                }
                parts.append(pd.DataFrame(run))
    return pd.concat(parts, ignore_index=True)


def complex_runs(table, method, P_n=0.15):
    rows = table[(table["method"] == method) & (table["remnant_intensity"] == P_n)]
    H = rows["H_real"].to_numpy() + 1j * rows["H_imag"].to_numpy()
    return H.reshape(-1, OMEGA.size)


def ends(bars):
    return np.array(bars.get_segments())[:, :, 1].T


@pytest.fixture(scope="module")
def table():
    return responses()


def test_means_and_spread_are_those_of_the_ensemble(table):
    display = StudyResponseDisplay.from_table(table, truth=TRUE)
    H = complex_runs(table, "batch")
    key = ("batch", 0.15)
    np.testing.assert_allclose(
        display.means_["magnitude", *key].get_ydata(), np.abs(H.mean(axis=0))
    )
    found = display.responses.query("method == 'batch'")
    np.testing.assert_allclose(found["magnitude_sd"], np.abs(H).std(axis=0, ddof=1))
    angles = np.degrees(np.angle(H / H.mean(axis=0)))
    np.testing.assert_allclose(found["phase_sd"], angles.std(axis=0, ddof=1))
    # Eqs. H.5-H.8 as FrequencyResponse has them.
    mean = FrequencyResponse(OMEGA, H).mean()
    np.testing.assert_allclose(found["total_sd"], mean.complex_sd)
    np.testing.assert_allclose(found["total_phase_sd"], mean.complex_phase_sd)
    assert (found["n"] == N).all()
    middle, sd = found["magnitude"].to_numpy(), found["magnitude_sd"].to_numpy()
    np.testing.assert_allclose(
        ends(display.bars_["spread", "magnitude", *key]), [middle - sd, middle + sd]
    )
    middle, sd = found["phase"].to_numpy(), found["total_phase_sd"].to_numpy()
    np.testing.assert_allclose(
        ends(display.bars_["total", "phase", *key]), [middle - sd, middle + sd]
    )


def test_stated_deviations_stand_beside(table):
    display = StudyResponseDisplay.from_table(table, truth=TRUE)
    key = ("recursive", 0.15)
    rows = table[table["method"] == "recursive"]
    stated = np.sqrt((rows["magnitude_sd"] ** 2).groupby(rows["omega"]).mean()).to_numpy()
    bars = display.bars_["stated", "magnitude", *key]
    low, high = ends(bars)
    np.testing.assert_allclose((high - low) / 2, stated)
    beside = np.array(bars.get_segments())[:, 0, 0]
    assert (beside > display.means_["magnitude", *key].get_xdata()).all()
    assert ("stated", "magnitude", "fc", 0.15) not in display.bars_
    found = display.responses.query("method == 'recursive'")
    np.testing.assert_allclose(found["stated_phase_sd"], np.degrees(0.5 * 0.015))


def test_deviations_have_axes_of_their_own(table):
    display = StudyResponseDisplay.from_table(table, truth=TRUE)
    found = display.responses.query("method == 'batch'")
    parts = ("magnitude", "phase")
    size, angle = (display.sd_lines_["spread", part, "batch", 0.15] for part in parts)
    np.testing.assert_allclose(size.get_ydata(), 100 * found["magnitude_sd"] / found["magnitude"])
    np.testing.assert_allclose(angle.get_ydata(), found["phase_sd"])
    stated = display.sd_lines_["stated", "magnitude", "batch", 0.15]
    # Half of what is found, of which twelve replications know a fifth (one sigma).
    ratio = stated.get_ydata() / size.get_ydata()
    assert 0.3 < np.median(ratio) < 0.8
    assert ("stated", "phase", "fc", 0.15) not in display.sd_lines_
    for row in display.axes_:
        assert len({panel.get_ylim() for panel in row}) == 1


def test_truth_tells_the_turn_of_a_phase(table):
    display = StudyResponseDisplay.from_table(table, truth=TRUE)
    expected = FrequencyResponse.of(HumanOperator(), OMEGA).phase
    for method in METHODS:
        phase = display.means_["phase", method, 0.15].get_ydata()
        np.testing.assert_allclose(phase, expected, atol=10)
    true = display.truth_[1]
    np.testing.assert_allclose(
        np.interp(OMEGA, true.get_xdata(), true.get_ydata()), expected, atol=1
    )
    H = TRUE(OMEGA)
    frame = pd.DataFrame({"omega": OMEGA, "H_real": H.real, "H_imag": H.imag})
    display = StudyResponseDisplay.from_table(table, truth=frame)
    np.testing.assert_allclose(display.truth_[0].get_ydata(), np.abs(H))


def test_bars_to_zero_are_cut_and_counted():
    table = responses((2.5,), ["fc"])
    display = StudyResponseDisplay.from_table(table, truth=TRUE)
    low = display.axes_[0, 0].get_ylim()[0]
    rows = display.responses
    lower = rows["magnitude"] - rows[["magnitude_sd", "total_sd"]].max(axis=1)
    cut = int(np.sum(lower < low))
    assert cut > 0
    assert display.notes_["fc"].get_text() == f"{cut} bar{'s' * (cut > 1)} cut"
    assert low > 0
    # A total deviation above the magnitude leaves the phase unknown (Eq. H.8).
    wide = rows["total_sd"] > rows["magnitude"]
    assert wide.any()
    assert (rows.loc[wide, "total_phase_sd"] == 180).all()
    covers_nothing(display)


def test_refusals(table):
    with pytest.raises(ValueError, match="no column 'phase_sd'; it has condition"):
        StudyResponseDisplay.from_table(table.drop(columns="phase_sd"))
    with pytest.raises(ValueError, match="would mix condition = C1, C2"):
        StudyResponseDisplay.from_table(pd.concat([table, responses(condition="C2")]))
    with pytest.raises(ValueError, match=r"no row has remnant_intensity = 0\.3"):
        StudyResponseDisplay.from_table(table, remnant_intensity=0.3)
    with pytest.raises(TypeError, match="truth is a function of omega or a table"):
        StudyResponseDisplay.from_table(table, truth=1.0)
    with pytest.raises(ValueError, match="omega is in rad/s and positive"):
        StudyResponseDisplay.from_table(table.assign(omega=table["omega"] - 0.23))
