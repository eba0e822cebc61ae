"""The thesis's studies as a user meets them: results, claims, figures, files, options."""

import numpy as np
import pandas as pd
import pytest

from skhoid import StudyWarning
from skhoid.lab.studies import paper_study

CELL = {"conditions": ["C1"], "intensities": [0.15]}


def test_fixed_and_estimated_delay_are_the_same_model_where_they_agree():
    table = paper_study("fig9", 6, orders=["nm"], **CELL, n_validation=1).table
    wide = table.pivot(index="replication", columns="delay")
    same = wide["nk"]["fixed"] == wide["nk"]["estimated"]
    assert same.sum() > 0
    for name in ("a1", "b1", "omega_nm", "vaf_validation"):
        fixed, estimated = wide[name]["fixed"][same], wide[name]["estimated"][same]
        np.testing.assert_array_equal(fixed, estimated, err_msg=name)
    assert (wide["nk"]["fixed"] == 29).all()


def test_an_intensity_out_of_reach_is_a_failure_not_the_end():
    options = {"orders": [4], "intensities": [0.1, 0.45], "gains": "tuned", "n_validation": 0}
    with pytest.warns(StudyWarning, match="2 of 4 data sets failed.*RemnantIntensityError"):
        found = paper_study("fig9", 2, conditions=["C2"], **options)
    failed = found.table.groupby("remnant_intensity")["error"].count()
    assert failed.to_dict() == {0.1: 0, 0.45: 2}
    assert len(found.summary) == 1


def test_gain_and_overfit():
    options = {"memory_horizons": [4, 256, np.inf], "n_validation": 2}
    found = paper_study("fig13", 2, conditions=["C4"], intensities=[0.1], **options)
    table = found.table.set_index(["form", "memory_horizon", "replication"])["vaf_validation"]
    table = table.sort_index()
    gain = (table["lambda", 256.0] - table["lambda", np.inf]).mean()
    of = found.summary.loc[("C4", 0.1, "lambda")]
    assert of["gain"][256.0] == pytest.approx(gain)
    assert of["gain"][np.inf] == 0
    assert of["overfit"][4.0] > of["overfit"][256.0] > 0
    endless = table.xs(np.inf, level="memory_horizon").unstack("form")
    np.testing.assert_array_equal(endless["lambda"], endless["Lambda"])
    overall = [claim for claim in found.claims if "over all conditions" in claim.statement]
    assert [claim.holds for claim in overall] == [None, None]  # on some cells only
    assert str(overall[0]).startswith("[not judged] Fig. 13: over all conditions")


def test_paths_begin_and_end_near_batch_models():
    found = paper_study("fig14", 4, intensities=[0.0, 0.15])
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
    ("name", "options"),
    [
        ("fig10", {"orders": [2], "n_validation": 1}),
        ("appJ", {"memory_horizons": [64, 256, np.inf], "n_validation": 1}),
        ("fig15", {}),
    ],
)
def test_study_by_name_draws_its_own_figures(name, options):
    found = paper_study(name, 2, conditions=["C4"], intensities=[0.0, 0.15], **options)
    assert found.figures
    shown = "figJ" if name == "appJ" else name
    assert all(key.startswith(shown) for key in found.figures)
    assert all(figure.axes for figure in found.plot().values())
    assert found.claims
    assert str(found).startswith(found.title)


def test_results_are_saved_and_a_study_in_a_folder_goes_on(tmp_path):
    options = {**CELL, "n_validation": 1, "out": tmp_path / "kept"}
    found = paper_study("fig12", 52, **options)  # two blocks
    files = found.save(tmp_path / "new")
    names = ["table.csv.gz", "summary.csv", "claims.csv", "fig12.png"]
    assert [path.name for path in files] == names
    assert len(pd.read_csv(files[0])) == len(found.table)
    assert set(pd.read_csv(files[2])) == {"source", "statement", "found", "holds"}
    sorted((tmp_path / "kept" / "blocks").glob("*.json"))[1].unlink()
    again = paper_study("fig12", 52, **options)
    pd.testing.assert_frame_equal(found.table, again.table, check_exact=True)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("fig31", {}, r"No study 'fig31'; there are fig9, .*Did you mean 'fig1"),
        ("appI", {"orders": [2]}, "'appI' has no option 'orders'"),
        ("fig9", {"orders": [5]}, r"Orders of the remnant filter must be among .*; got 5"),
        ("fig13", {"memory_horizons": [64]}, "include infinity"),
        ("fig13", {"memory_horizons": [1, np.inf]}, "above 1"),
    ],
)
def test_errors(name, options, message):
    with pytest.raises(ValueError, match=message):
        paper_study(name, **options)
