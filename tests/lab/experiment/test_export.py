import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest
from support.parameter_tables import simulated

from skhoid.lab.experiment import mixed_model, write_long, write_wide


@pytest.fixture(scope="module")
def results():
    lag = simulated(1, people=6, runs=1).assign(parameter="T_L", unit="s")
    return [
        mixed_model(simulated(people=6), "K_e"),
        mixed_model(lag, "T_L", transform="log", reference="C1"),
        mixed_model(simulated(2, conditions=1).assign(parameter='a "b"'), 'a "b"'),
    ]


def test_long_file_has_all_rows_and_their_weights(results, tmp_path):
    csv, script = write_long(results, tmp_path / "new")
    rows = pd.read_csv(csv)
    assert rows["parameter"].value_counts().to_dict() == {r.parameter: len(r.data) for r in results}
    used = rows[(rows["parameter"] == "K_e") & (rows["used"] == 1)]
    np.testing.assert_allclose(used["weight"], results[0].data["weight"].dropna(), rtol=1e-15)
    assert sorted(p.name for p in csv.parent.iterdir()) == sorted([csv.name, script.name])


def test_script_holds_the_numbers_and_the_model(results, tmp_path):
    text = write_long(results, tmp_path)[1].read_text(encoding="utf-8")
    assert "lmer(value ~ 0 + condition + (1 | subject), data = cells, weights = cell_weight" in text
    assert repr(float(results[0].omnibus.F)) in text
    for value in results[1].contrasts["difference"]:
        assert repr(float(value)) in text
    assert r'parameter == "a \"b\""' in text
    assert text.count("(") == text.count(")")
    assert text.count("{") == text.count("}")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("Rscript") is None, reason="R is not installed")
def test_r_finds_the_same(results, tmp_path):
    _, script = write_long(results, tmp_path)
    done = subprocess.run(["Rscript", str(script)], capture_output=True, text=True, check=False)
    assert "R and skhoid agree" in done.stdout, done.stderr


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
    omega = simulated(1).assign(parameter="ω_nm", unit="rad/s^2")
    long = simulated(2, conditions=1).assign(parameter="x" * 90, unit="%", condition="all")
    alike = long.assign(parameter="X" * 91)
    failed = simulated().iloc[[0]].assign(subject="S99", parameter="", failure="too short")
    table = pd.concat([simulated(), omega, long, alike, failed])
    path = write_wide(table, tmp_path / "wide.csv")
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")
    wide = pd.read_csv(path, encoding="utf-8-sig").set_index("subject")
    assert wide.columns[0] == "K_e_C1_deg_per_deg"
    assert wide.columns[7] == "omega_nm_C4_rad_per_s2"
    assert len({name.lower() for name in wide}) == 10
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{,63}", name) for name in wide)
    assert wide.columns[8].endswith("x_percent")
    means = simulated().groupby(["subject", "condition"])["estimate"].mean()
    assert wide.loc["S2", "K_e_C3_deg_per_deg"] == pytest.approx(means["S2", "C3"])
    assert np.isnan(wide.loc["S11", "K_e_C4_deg_per_deg"])
    assert wide.loc["S99"].isna().all()
