"""read_experiment: every layout gives the signals and labels that were written."""

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal, assert_series_equal
from scipy.io import savemat
from support.experiments import (
    CONDITIONS,
    DT,
    PEOPLE,
    RUNS,
    each_run,
    experiment,
    padded,
    write_bids_motion,
    write_xdf,
)

from skhoid import read_experiment, read_runs

NAMED = {"inputs": "e", "output": "u", "time": "t"}


@pytest.fixture(scope="module")
def truth():
    return experiment()


def assert_same(read, truth, *, names=("subject", "condition", "run", "time")):
    X, y = truth
    assert read[0].index.names == list(names)
    assert read[1].index.equals(read[0].index)
    assert list(map(tuple, read[0].index.droplevel("time"))) == list(
        map(tuple, X.index.droplevel("time"))
    )
    got = [table.set_axis(X.index, axis=0) for table in read]
    times = read[0].index.get_level_values("time")
    np.testing.assert_allclose(times, X.index.get_level_values("time"), atol=1e-9)
    assert_frame_equal(got[0], X, check_exact=False, atol=1e-12)
    assert_series_equal(got[1], y, check_exact=False, atol=1e-12)


def with_labels(*, subject=PEOPLE, condition=CONDITIONS, run=RUNS):
    """The same signals under other labels."""
    return experiment(people=subject, conditions=condition, runs=run)


def write_csvs(folder, truth, name, **options):
    for (s, c, r), run in each_run(*truth):
        path = folder / name.format(s=s, c=c, r=r)
        path.parent.mkdir(parents=True, exist_ok=True)
        run.to_csv(path, index=False, **options)


@pytest.mark.parametrize(
    ("written", "pattern"),
    [
        ("{s}/{c}/run{r}.csv", "{subject}/{condition}/run{run}.csv"),
        ("sub-{s}_cond-{c}_run-{r}.csv", "sub-{subject}_cond-{condition}_run-{run}.csv"),
        ("{s}/{s}_{c}_x{r}_7.csv", "{subject}/{subject}_{condition}_x{run}_*.csv"),
        ("[{s}] {c}+{r}.csv", "[{subject}] {condition}+{run}.csv"),
    ],
)
def test_csv_by_pattern(tmp_path, truth, written, pattern, capsys):
    write_csvs(tmp_path, truth, written)
    (tmp_path / "notes.csv").write_text("not, a recording\n")
    assert_same(read_experiment(f"{tmp_path}/{pattern}", **NAMED, some=True), truth)
    assert "12 of 13 files match" in capsys.readouterr().out


@pytest.mark.parametrize(
    "written",
    [
        "sub-{s}_task-{c}_run-{r}.csv",
        "sub-{s}/sub-{s}_task-{c}_trial{r}.csv",
        "{s}/{c}/{r}.csv",
        "{s}-{c}-{r}.csv",
        "pilot/{s}/{c}_run {r}.csv",
        "tracking_{s}_{c}_R_{r}_final.csv",
    ],
)
def test_csv_in_a_folder_by_names(tmp_path, truth, written, capsys):
    write_csvs(tmp_path, truth, written)
    assert_same(read_experiment(tmp_path), truth)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("Files: 12, 2 people, 2 conditions, 12 runs; labels by ")
    assert "{subject}" in line
    assert "{condition}" in line
    assert "{run}" in line
    assert 'time "t"' in line


@pytest.mark.parametrize(
    "conditions",
    [
        ("fast", "fast_tired"),
        ("motion", "no_motion"),
        ("C1_low", "C1_high"),
        ("fast_rested", "slow_tired", "slow_rested", "fast_tired"),
        ("low-2 Hz", "no low-2 Hz"),
    ],
)
@pytest.mark.parametrize("form", ["{s}/{c}/run{r}", "{s}/{c}_{r}", "{s}_{c}_r{r}", "{c}/{s}/{r}"])
@pytest.mark.parametrize("people", [("P01", "P02"), ("anna", "ben")])
def test_conditions_of_several_words(tmp_path, conditions, form, people):
    """Whole names of folders, and neighbours in a name, are one condition."""
    keys = {(s, c, r) for s in people for c in conditions for r in "12"}
    for s, c, r in keys:
        write_rows(tmp_path / (form.format(s=s, c=c, r=r) + ".csv"))
    if form.startswith("{c}/") and people[0] == "anna" and "C1_low" not in conditions:
        with pytest.raises(ValueError, match=r"Give the pattern, such as .*, which matches all"):
            read_experiment(tmp_path, **NAMED)  # which of the folders are people?
        return
    X, _ = read_experiment(tmp_path, **NAMED)
    assert {(s, c, r.lstrip("r")) for s, c, r, _ in X.index} == keys


def write_rows(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("t,e,u\n0,1,2\n0.01,1.5,2.5\n0.02,1,3\n")


def test_a_pattern_that_matches_some_of_the_files_is_asked_about(tmp_path, capsys):
    for c in ("fast", "fast_tired", "slow"):
        write_rows(tmp_path / "P1" / c / "run1.csv")
    write_rows(tmp_path / "participants.csv")  # which is no recording
    pattern = f"{tmp_path}/{{subject}}/{{condition}}_*/run{{run}}.csv"
    with pytest.raises(ValueError, match=r"1 of 3 files match .*fast/run1.csv.*--some"):
        read_experiment(pattern, **NAMED)
    X, _ = read_experiment(pattern, **NAMED, some=True)
    assert list(X.index.unique("condition")) == ["fast"]
    assert "1 of 3 files match the pattern, the others are not read" in capsys.readouterr().out


def test_names_and_a_column_say_the_same(tmp_path, truth):
    for (s, c, r), run in each_run(*truth):
        run.assign(trial=int(r)).to_csv(tmp_path / f"{s}_{c}_{r}.csv", index=False)
    assert_same(read_experiment(tmp_path), truth)


def test_vectors_in_a_struct_of_each_file(tmp_path, truth):
    for (s, c, r), run in each_run(*truth):
        (tmp_path / s).mkdir(exist_ok=True)
        content = {name: run[name].to_numpy() for name in run}
        savemat(tmp_path / s / f"{c}_{r}.mat", {"data": content})
    assert_same(read_experiment(tmp_path), truth)
    named = {"inputs": "data.e", "output": "data.u", "time": "data.t"}
    assert_same(read_experiment(tmp_path, **named), truth)


def test_glued_keys_keep_short_letters(tmp_path, truth):
    for (s, c, r), run in each_run(*truth):
        run.to_csv(tmp_path / f"{s}C{CONDITIONS.index(c) + 1}R{r}.csv", index=False)
    expected = with_labels(condition=("C1", "C2"), run=("R1", "R2", "R10"))
    assert_same(read_experiment(tmp_path, **NAMED), expected)


def test_decimal_comma_in_folders_per_condition(tmp_path, truth):
    write_csvs(tmp_path, truth, "{c}/{s}_{r}.csv", sep=";", decimal=",")
    assert_same(read_experiment(f"{tmp_path}/{{condition}}/{{subject}}_{{run}}.csv"), truth)


def long_table(truth, names):
    rows = [
        run.assign(**dict(zip(names, key, strict=True)))[[*names, "t", "e", "u"]]
        for key, run in each_run(*truth)
    ]
    return pd.concat(rows, ignore_index=True)


def test_columns_of_two_factors_are_one_condition(tmp_path):
    table = long_table(experiment(conditions=("fast_rested", "slow_tired")), ["who", "c", "run"])
    table["pace"], table["state"] = zip(*table.pop("c").str.split("_"), strict=True)
    table.to_csv(tmp_path / "all.csv", index=False)
    X, _ = read_experiment(tmp_path / "all.csv", subject="who", condition=["pace", "state"])
    assert list(X.index.unique("condition")) == ["fast_rested", "slow_tired"]
    assert X.index.droplevel("time").nunique() == 12


def test_one_long_table(tmp_path, truth, capsys):
    path = tmp_path / "all.csv"
    long_table(truth, ["subject", "condition", "run"]).to_csv(path, index=False)
    expected = with_labels(run=(1, 2, 10))
    assert_same(read_experiment(path), expected)
    assert 'subject "subject"' in capsys.readouterr().out
    assert_same(read_experiment(tmp_path, **NAMED), expected)


def test_parquet_with_named_columns(tmp_path, truth):
    long_table(truth, ["code", "setting", "no"]).to_parquet(tmp_path / "all.parquet")
    levels = {"subject": "code", "condition": "setting", "run": "no"}
    assert_same(read_experiment(tmp_path / "all.parquet", **levels, **NAMED), truth)


def test_one_table_for_each_person(tmp_path, truth):
    table = long_table(truth, ["who", "task", "trial"])
    for person, rows in table.groupby("who"):
        rows.drop(columns="who").to_csv(tmp_path / f"{person}.csv", index=False)
    expected = with_labels(run=(1, 2, 10))
    assert_same(read_experiment(f"{tmp_path}/*.csv", **NAMED), expected)
    assert_same(read_experiment(f"{tmp_path}/{{subject}}.csv", **NAMED), expected)


def test_runs_that_only_the_clock_tells_apart(tmp_path, truth):
    for (s, c), rows in long_table(truth, ["s", "c", "r"]).groupby(["s", "c"]):
        rows[["t", "e", "u"]].to_csv(tmp_path / f"{s}_{c}.csv", index=False)
    expected = with_labels(run=("1", "2", "3"))
    assert_same(read_experiment(f"{tmp_path}/{{subject}}_{{condition}}.csv"), expected)


@pytest.mark.parametrize("latency", [False, True])
def test_bids_motion(tmp_path, truth, latency):
    write_bids_motion(tmp_path, *truth, latency=latency)
    X, y = read_experiment(tmp_path)
    assert_same((X, y), truth)
    assert X.attrs["units"] == {"e": "deg"}
    pattern = "sub-{subject}/motion/sub-{subject}_task-{condition}_run-{run}_motion.tsv"
    assert_same(read_experiment(f"{tmp_path}/{pattern}", inputs="e", output="u"), truth)


def variables(truth):
    """Arrays samples x runs of each person and condition."""
    for s, person in enumerate(PEOPLE):
        for c, condition in enumerate(CONDITIONS):
            own = {name: padded(*truth, name)[:, :, c, s] for name in ("e", "u")}
            kept = np.isfinite(own["e"]).any(axis=1)
            yield person, condition, {k: v[kept] for k, v in own.items()} | {"dt": DT}


def write_mat5(path, content, _):
    savemat(path, content)


def write_mat73(path, content, write):
    write(path, {k: np.atleast_2d(np.asarray(v, dtype=float)) for k, v in content.items()})


def write_npz(path, content, _):
    np.savez(path, **content)


ARRAY_FORMATS = [("mat", write_mat5), ("mat", write_mat73), ("npz", write_npz)]
COUNTED = {"run": ("1", "2", "3")}


@pytest.mark.parametrize(("suffix", "write"), ARRAY_FORMATS)
def test_samples_by_runs_in_a_file_for_each_person(tmp_path, truth, suffix, write, write_mat73):
    for person, condition, content in variables(truth):
        write(tmp_path / f"{person}_{condition}.{suffix}", content, write_mat73)
    expected = with_labels(**COUNTED)
    assert_same(read_experiment(tmp_path), expected)
    pattern = f"{tmp_path}/{{subject}}_{{condition}}.{suffix}"
    dims = {"time": None, "run": RUNS}
    assert_same(read_experiment(pattern, inputs="e", output="u", dt=DT, dims=dims), truth)


@pytest.mark.parametrize(("suffix", "write"), ARRAY_FORMATS)
def test_samples_by_runs_by_people(tmp_path, truth, suffix, write, write_mat73, capsys):
    for c, condition in enumerate(CONDITIONS):
        content = {name: padded(*truth, name)[:, :, c] for name in ("e", "u")} | {"dt": DT}
        write(tmp_path / f"{condition}.{suffix}", content, write_mat73)
    expected = with_labels(subject=("1", "2"), **COUNTED)
    assert_same(read_experiment(tmp_path), expected)
    assert 'dims=("time", "run", "subject")' in capsys.readouterr().out


@pytest.mark.parametrize(("suffix", "write"), ARRAY_FORMATS)
def test_four_dimensions(tmp_path, truth, suffix, write, write_mat73):
    content = {name: padded(*truth, name) for name in ("e", "u")}
    content["t"] = np.arange(len(content["e"])) * DT
    write(tmp_path / f"all.{suffix}", content, write_mat73)
    expected = with_labels(subject=("1", "2"), condition=("1", "2"), **COUNTED)
    assert_same(read_experiment(tmp_path / f"all.{suffix}"), expected)


def test_dimensions_in_another_order(tmp_path, truth):
    content = {name: padded(*truth, name).transpose(3, 2, 0, 1) for name in ("e", "u")}
    np.savez(tmp_path / "all.npz", **content)
    dims = {"subject": PEOPLE, "condition": CONDITIONS, "time": None, "run": RUNS}
    read = read_experiment(tmp_path / "all.npz", inputs="e", output="u", dt=DT, dims=dims)
    assert_same(read, truth)


def test_a_missing_run_is_no_run(tmp_path, truth):
    gone = [key[:3] == ("S1", "lead", "2") for key in truth[0].index]
    X, y = (table[~np.array(gone)] for table in truth)
    content = {name: padded(*truth, name) for name in ("e", "u")}
    for values in content.values():
        values[:, 1, 1, 0] = np.nan
    np.savez(tmp_path / "all.npz", **content)
    dims = {"time": None, "run": RUNS, "condition": CONDITIONS, "subject": PEOPLE}
    read = read_experiment(tmp_path / "all.npz", inputs="e", output="u", dt=DT, dims=dims)
    assert_same(read, (X, y))


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_struct_of_people(tmp_path, truth, write_mat73, version):
    people = {person: {} for person in PEOPLE}
    for person, condition, content in variables(truth):
        del content["dt"]
        people[person][condition] = content
    content = {"data": people, "t": np.arange(60.0)[:, None] * DT}
    path = tmp_path / "all.mat"
    if version == "5":
        savemat(path, content)
    else:
        write_mat73(path, content)
    assert_same(read_experiment(path), with_labels(**COUNTED))
    assert_same(read_experiment(path, **NAMED), with_labels(**COUNTED))


def test_struct_array_of_people(tmp_path, truth):
    people = np.zeros((1, 2), dtype=[("id", object), ("e", object), ("u", object)])
    for s, person in enumerate(PEOPLE):
        people[0, s] = (person, *(padded(*truth, name)[:, :, 0, s] for name in ("e", "u")))
    savemat(tmp_path / "gain.mat", {"people": people})
    X, y = (table.xs("gain", level="condition") for table in with_labels(**COUNTED))
    X, y = (table.rename({"S1": "1", "S2": "2"}, level="subject") for table in (X, y))
    read = read_experiment(tmp_path / "gain.mat", inputs="e", output="u", dt=DT)
    assert_same(read, (X, y), names=("subject", "run", "time"))


@pytest.mark.slow
def test_xdf(tmp_path):
    pytest.importorskip("pyxdf")
    truth = experiment(conditions=("gain",), runs=("1",))
    for (s, c, r), run in each_run(*truth):
        coarse = run.iloc[::2]
        slower = (coarse["t"].to_numpy(), coarse["u"].to_numpy(), ["u"], ["N"], 50)
        write_xdf(
            tmp_path / f"sub-{s}_task-{c}_run-{r}.xdf",
            {
                "Screen": (run["t"].to_numpy() + 5, run["e"].to_numpy(), ["e"], ["deg"], 100),
                "Stick": (slower[0] + 5, *slower[1:]),
                "Marks": ([5.0, 5.1], ["go", "stop"], [], [], 0),
            },
            clock_offsets={"Stick": 1234.5},
        )
    X, y = read_experiment(tmp_path)
    runs = list(each_run(*truth))
    for (s, c, r), run in runs:
        own, output = X.loc[s, c, r], y.loc[s, c, r]
        last = (len(run) - 1) // 2 * 2 + 1  # the slower stream ends there
        np.testing.assert_allclose(own.index, run["t"][:last], atol=1e-6)
        np.testing.assert_allclose(own["e"], run["e"][:last], atol=1e-3)
        between = np.interp(run["t"][:last], run["t"][::2], run["u"][::2])
        np.testing.assert_allclose(output, between, atol=1e-3)
    assert X.attrs["units"] == {"e": "deg"}
    X, _ = read_experiment(tmp_path, inputs="Screen.e", output="Stick.u", dt=0.02)
    assert np.median(np.diff(X.loc["S1", "gain", "1"].index)) == pytest.approx(0.02)
    X, _ = read_runs(tmp_path / "sub-S1_task-gain_run-1.xdf", inputs="e", output="u", time="time")
    assert list(X) == ["e"]


def test_npz_with_read_runs(tmp_path, truth):
    _, run = next(each_run(*truth))
    np.savez(tmp_path / "one.npz", **{name: run[name].to_numpy() for name in run})
    X, y = read_runs(tmp_path / "one.npz", **NAMED)
    np.testing.assert_array_equal(X["e"], run["e"])
    np.testing.assert_array_equal(y, run["u"])
