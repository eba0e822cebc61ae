import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest
from support.parameter_tables import simulated

from skhoid.lab.experiment import mixed_model, write_long, write_wide
from skhoid.lab.experiment.export import LONGEST, unit_suffix, variable_names


@pytest.fixture(scope="module")
def results():
    lag = simulated(1, runs=1).assign(parameter="T_L", unit="s")
    return [
        mixed_model(simulated(), "K_e"),
        mixed_model(lag, "T_L", transform="log", reference="C1"),
        mixed_model(simulated(2, conditions=1).assign(parameter='a "b"'), 'a "b"'),
    ]


def test_long_file_has_all_rows_and_their_weights(results, tmp_path):
    csv, script = write_long(results, tmp_path / "new")
    rows = pd.read_csv(csv)
    assert rows["parameter"].value_counts().to_dict() == {r.parameter: len(r.data) for r in results}
    used = rows[(rows["parameter"] == "K_e") & (rows["used"] == 1)]
    np.testing.assert_array_equal(used["weight"], results[0].data["weight"].dropna())
    assert {"unit", "left_out", "value_se"} <= set(rows)
    assert sorted(p.name for p in csv.parent.iterdir()) == sorted([csv.name, script.name])


def test_script_holds_the_numbers_and_the_model(results, tmp_path):
    text = write_long(results, tmp_path)[1].read_text(encoding="utf-8")
    assert "lmer(value ~ 0 + condition + (1 | subject), data = cells, weights = cell_weight" in text
    assert repr(float(results[0].omnibus.F)) in text
    assert repr(results[0].criterion) in text
    for value in results[1].contrasts["difference"]:
        assert repr(float(value)) in text
    assert r'parameter == "a \"b\""' in text
    assert 'ddf = "Kenward-Roger"' in text
    assert "emmeans(model, ~ condition" in text
    assert text.count("(") == text.count(")")
    assert text.count("{") == text.count("}")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("Rscript") is None, reason="R is not installed")
def test_r_finds_the_same(results, tmp_path):
    _, script = write_long(results, tmp_path)
    done = subprocess.run(["Rscript", str(script)], capture_output=True, text=True, check=False)
    assert "R and skhoid agree" in done.stdout, done.stderr


@pytest.mark.slow
def test_a_table_is_fitted_for_each_parameter(tmp_path):
    table = pd.concat([simulated(people=3, conditions=2).assign(parameter=p) for p in "ab"])
    csv, _ = write_long(table, tmp_path, transform="log")
    assert pd.read_csv(csv)["parameter"].unique().tolist() == ["a", "b"]
    with pytest.raises(ValueError, match="transform: of use with a table only"):
        write_long(mixed_model(table, "a"), tmp_path / "x", transform="log")


def test_nothing_is_replaced_unless_asked(results, tmp_path):
    csv, script = write_long(results[0], tmp_path)
    script.unlink()
    before = csv.read_bytes()
    with pytest.raises(FileExistsError, match="overwrite=True"):
        write_long(results[1], tmp_path)
    assert csv.read_bytes() == before
    assert not script.exists()
    write_long(results[1], tmp_path, overwrite=True)
    assert csv.read_bytes() != before
    wide = write_wide(simulated(), tmp_path / "wide.csv")
    with pytest.raises(FileExistsError, match="would be replaced"):
        write_wide(simulated(), wide)


def test_wide_file_has_a_row_for_each_person(tmp_path):
    table = pd.concat([simulated(), simulated(1).assign(parameter="ω_nm", unit="rad/s")])
    failed = (
        simulated()
        .iloc[[0]]
        .assign(subject="S99", parameter="", estimate=np.nan, failure="too short")
    )
    path = write_wide(pd.concat([table, failed]), tmp_path / "wide.csv")
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")
    wide = pd.read_csv(path, encoding="utf-8-sig").set_index("subject")
    assert wide.columns[0] == "K_e_C1_deg_per_deg"
    assert wide.columns[-1] == "omega_nm_C4_rad_per_s"
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in wide)
    means = simulated().groupby(["subject", "condition"])["estimate"].mean()
    assert wide.loc["S2", "K_e_C3_deg_per_deg"] == pytest.approx(means["S2", "C3"])
    assert np.isnan(wide.loc["S11", "K_e_C4_deg_per_deg"])
    assert wide.loc["S99"].isna().all()


def test_names_are_safe_short_and_distinct():
    wanted = [
        ("K e", "_s"),
        ("K_e", "_s"),
        ("k-E", "_s"),
        ("1st", ""),
        ("x" * 90, "_deg"),
        ("all", ""),
    ]
    names = variable_names([*wanted, ("x" * 91, "_deg"), ("力", "")])
    assert len({name.lower() for name in names}) == len(names)
    assert all(len(name.encode()) <= LONGEST for name in names)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in names)
    assert names[4].endswith("_deg")
    assert names[5] != "all"
    assert unit_suffix("%") == "_percent"
    assert unit_suffix("s^-1") == "_sminus1"
