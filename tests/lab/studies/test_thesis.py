"""The thesis's studies as a user meets them: results, claims, figures, files, options."""

import numpy as np
import pandas as pd
import pytest

from skhoid import CompensatoryTask, StudyWarning
from skhoid.lab.studies import PAPER_STUDIES, Claim, paper_study
from skhoid.lab.studies.memory_horizons import candidate_delays, kept_run_in

pytestmark = pytest.mark.slow  # simulates studies

INTENSITY = {"conditions": ["C1"], "intensities": [0.15]}


def test_delays_are_those_of_the_thesis():
    nks = candidate_delays(CompensatoryTask())
    assert (nks[0], nks[-1]) == (15, 48)
    slow = CompensatoryTask.of_condition("C1", sampling_rate=50.0)
    assert (candidate_delays(slow)[0], candidate_delays(slow)[-1]) == (8, 24)
    with pytest.raises(ValueError, match=r"run-in of 0.5 s; 1 s are needed"):
        kept_run_in(CompensatoryTask(run_in=0.5))


def test_fixed_and_estimated_delay_are_the_same_model_where_they_agree():
    table = paper_study("fig9", 6, orders=["nm"], **INTENSITY, n_validation=2).table
    wide = table.pivot(index="replication", columns="delay")
    same = wide["nk"]["fixed"] == wide["nk"]["estimated"]
    assert same.sum() > 0
    for name in ("a1", "b1", "omega_nm", "vaf_validation"):
        np.testing.assert_array_equal(
            wide[name]["fixed"][same], wide[name]["estimated"][same], err_msg=name
        )
    assert (wide["nk"]["fixed"] == 29).all()


def test_all_rates_and_loops():
    found = paper_study(
        "fig9",
        2,
        orders=[2],
        **INTENSITY,
        sampling_rates=[50, 100, 200],
        open_loop=[False, True],
        n_validation=0,
    )
    fixed = found.summary["nk_fixed"].groupby("sampling_rate").first()
    assert fixed.to_dict() == {50.0: 15, 100.0: 29, 200.0: 57}
    assert len(found.figures) == 6
    assert "vaf_validation" not in found.table


def test_filters_share_their_noise():
    """The same realisations go through all filters: with no gain in common, biases move as one."""
    table = paper_study("fig9", 12, orders=[3, 4], **INTENSITY, n_validation=0).table
    bias = table[table["delay"] == "fixed"].pivot(
        index="replication", columns="remnant_order", values="bias_b0"
    )
    assert bias.corr().iloc[0, 1] > 0.8


def test_tuned_gains_are_near_those_of_the_table():
    found = {
        gains: paper_study(
            "fig13", 24, **INTENSITY, memory_horizons=[256, np.inf], n_validation=2, gains=gains
        )
        .table["P_n"]
        .mean()
        for gains in ("table", "tuned")
    }
    assert found["table"] == pytest.approx(found["tuned"], rel=0.1)
    assert found["table"] != found["tuned"]


def test_an_intensity_out_of_reach_is_a_failure_not_the_end():
    with pytest.warns(StudyWarning, match="4 of 8 data sets failed.*RemnantIntensityError"):
        found = paper_study(
            "fig9",
            4,
            conditions=["C2"],
            orders=[4],
            intensities=[0.1, 0.45],
            gains="tuned",
            n_validation=0,
        )
    failed = found.table.groupby("remnant_intensity")["error"].count()
    assert failed.to_dict() == {0.1: 0, 0.45: 4}
    assert len(found.summary) == 1


def test_gain_and_overfit():
    found = paper_study(
        "fig13",
        3,
        conditions=["C4"],
        intensities=[0.1],
        memory_horizons=[4, 256, np.inf],
        n_validation=3,
    )
    table = found.table.set_index(["form", "memory_horizon", "replication"])["vaf_validation"]
    table = table.sort_index()
    gain = (table["lambda", 256.0] - table["lambda", np.inf]).mean()
    of = found.summary.loc[("C4", 0.1, "lambda")]
    assert of["gain"][256.0] == pytest.approx(gain)
    assert of["gain"][np.inf] == 0
    assert of["overfit"][4.0] > of["overfit"][256.0] > 0
    endless = table.xs(np.inf, level="memory_horizon").unstack("form")
    np.testing.assert_array_equal(endless["lambda"], endless["Lambda"])


def test_runs_without_remnant_have_one_trade_off():
    """Computed for one replication, and found in the rows of all."""
    options = {"conditions": ["C4"], "memory_horizons": [64, np.inf], "n_validation": 2}
    many, one = (paper_study("fig13", n, intensities=[0.0], **options).table for n in (3, 1))
    for replication, rows in many.groupby("replication"):
        rows = rows.assign(replication=0).reset_index(drop=True)
        pd.testing.assert_frame_equal(rows, one, check_exact=True, obj=f"replication {replication}")
    assert np.ptp(many["vaf_validation"].to_numpy()) > 1


def test_paths_begin_and_end_near_batch_models():
    found = paper_study("fig14", 6, intensities=[0.0, 0.15])
    table = found.table
    ends = table[table["form"].isin(["ini", "fin"])]
    assert ends["time"].isna().all()
    mean = table.groupby(["remnant_intensity", "form"])["b0"].mean()
    last = table[table["time"] > 70].groupby(["remnant_intensity", "form"])["b0"].mean()
    for P_n in (0.0, 0.15):
        for form in ("lambda", "Lambda"):
            assert last[P_n, form] == pytest.approx(mean[P_n, "fin"], rel=0.15)
    start = table[table["time"] == 0].set_index(["remnant_intensity", "replication"])
    assert (start[start["form"] == "lambda"]["a1"] == start[start["form"] == "Lambda"]["a1"]).all()
    assert (found.summary.loc[("C4", 0.0), "sd_a1"] == 0).all()  # every replication is the same


def test_responses_without_remnant_are_the_operators():
    found = paper_study("appI", 1, conditions=["C1"], intensities=[0.0])
    assert found.summary["bias"].abs().max() < 0.02
    assert [claim.holds for claim in found.claims] == [True]


@pytest.mark.parametrize(
    "name",
    ["fig9", "fig13"]
    + [pytest.param(name) for name in ("fig10", "fig12", "appJ", "fig14", "fig15")],
)
def test_study_by_name_draws_its_own_figures(name):
    options = {"conditions": ["C4" if name[-1] in "45" else "C1"], "intensities": [0.0, 0.15]}
    if "n_validation" in PAPER_STUDIES[name].options:
        options["n_validation"] = 1
    if name in ("fig13", "appJ"):
        options["memory_horizons"] = [64, 256, np.inf]
    found = paper_study(name, 3, **options)
    figures = found.plot()
    wanted = PAPER_STUDIES[name].shown
    assert figures
    assert all(key.startswith(wanted) for key in figures)
    assert found.claims
    assert str(found).startswith(found.title)
    everything = paper_study(name, 3, every_figure=True, **options)
    assert set(figures) <= set(everything.figures)
    pd.testing.assert_frame_equal(found.table, everything.table)


def test_results_are_saved(tmp_path):
    found = paper_study("fig12", 2, **INTENSITY, n_validation=1)
    files = found.save(tmp_path / "new")
    assert [path.name for path in files] == [
        "table.csv.gz",
        "summary.csv",
        "claims.csv",
        "fig12.png",
    ]
    assert len(pd.read_csv(files[0])) == len(found.table)
    assert set(pd.read_csv(files[2])) == {"source", "statement", "found", "holds"}


def test_claims_about_all_cells_are_not_judged_on_some():
    found = paper_study("fig13", 2, **INTENSITY, memory_horizons=[256, np.inf], n_validation=1)
    overall = [claim for claim in found.claims if "over all conditions" in claim.statement]
    assert [claim.holds for claim in overall] == [None, None]
    assert str(Claim("Fig. 1", "a", "b", None)) == "[not judged] Fig. 1: a. Found: b."


def test_a_study_in_a_folder_goes_on(tmp_path):
    options = {"conditions": ["C4"], "intensities": [0.1], "n_validation": 1, "out": tmp_path}
    options["memory_horizons"] = [256, np.inf]
    first = paper_study("fig13", 60, **options).table  # two blocks
    block = sorted((tmp_path / "blocks").glob("*.parquet"))[1]
    block.unlink()
    again = paper_study("fig13", 60, **options, n_jobs=2).table
    pd.testing.assert_frame_equal(first, again, check_exact=True)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: paper_study("fig31"), r"No study 'fig31'; there are fig9, .*Did you mean 'fig1"),
        (lambda: paper_study("appI", orders=[2]), "'appI' has no option 'orders'"),
        (
            lambda: paper_study("fig9", 2, orders=[5]),
            r"Orders of the remnant filter must be among .*; got 5",
        ),
        (lambda: paper_study("fig9", 2, gains="fitted"), "gains must be 'table'"),
        (lambda: paper_study("fig13", 2, memory_horizons=[64]), "include infinity"),
        (lambda: paper_study("fig13", 2, memory_horizons=[1, np.inf]), "above 1"),
        (lambda: paper_study("fig13", 2, n_validation=0), "n_validation must be at least 1"),
        (lambda: paper_study("fig14", 2, conditions=["C9"]), "Unknown condition 'C9'"),
        (lambda: paper_study("appI", 0), "n_replications must be a whole number, at least 1"),
    ],
)
def test_errors(call, message):
    with pytest.raises(ValueError, match=message):
        call()
