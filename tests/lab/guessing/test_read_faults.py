"""read_experiment refuses what it cannot read whole, and says which file and what to do."""

import numpy as np
import pytest
from scipy.io import savemat
from support.experiments import each_run, experiment, write_bids_motion

from skhoid import read_experiment

NAMED = {"inputs": "e", "output": "u", "time": "t"}
ROWS = "t,e,u\n0,1,2\n0.1,2,3\n0.2,2,1\n"


@pytest.fixture
def folder(tmp_path):
    for person in ("S1", "S2"):
        for run in "123":
            (tmp_path / f"{person}_gain_{run}.csv").write_text(ROWS)
    return tmp_path


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        ("{subject}-{run}.csv", r"No file matches the pattern .* has: 'S1_gain_1.csv'.* 1 more"),
        ("{who}.csv", r"has the field \{who\}; fields are \{subject\}"),
        ("{subject}_gain_*.csv", r"Two files give subject 'S1', run '1': .*csv and .*csv"),
        ("nothing", "There is no file"),
        ("../nowhere/{subject}.csv", "No file matches"),
    ],
)
def test_patterns(folder, paths, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_experiment(f"{folder}/{paths}", **NAMED)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "S1_gain_2.csv is empty"),
        ("t,e,u\n", "S1_gain_2.csv has a header but no rows"),
        ("t,err,u\n0,1,2\n", r"S1_gain_2.csv has no column 'e'.*first file is .*S1_gain_1.csv"),
        ("t,e [rad],u\n0,1,2\n1,1,2\n", "unit of channel 'e' is 'deg' in .*_1.csv and 'rad' in"),
        ("t,e,u\n0,1,2\n.1,1,2\n.05,1,2\n", "subject 'S1', run '2'.* does not increase at row 3"),
        ("t,e,u\n0,1,2\n,1,2\n", "missing in its row 2"),
    ],
)
def test_one_bad_file(folder, text, message):
    (folder / "S1_gain_1.csv").write_text(ROWS.replace("e", "e [deg]"))
    (folder / "S1_gain_2.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_experiment(folder, **NAMED)


def add_redo(folder):
    (folder / "S1_gain_1_redo.csv").write_text(ROWS)


def add_mat(folder):
    savemat(folder / "S1.mat", {"e": 1.0})


def add_deeper(folder):
    (folder / "more").mkdir()
    (folder / "more" / "S1_gain_1.csv").write_text(ROWS)


def two_keys(folder):
    (folder / "S1_sub-S2_gain_1.csv").write_text(ROWS)


def only_numbers(folder):
    for path in list(folder.iterdir()):
        path.unlink()
    for number in "12":
        (folder / f"{number}.csv").write_text(ROWS)


def no_files(folder):
    for path in list(folder.iterdir()):
        path.unlink()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (add_redo, r"built differently: .*'S1_gain_1_redo.csv'. Give .*\{subject\}_gain_\{con"),
        (add_mat, r"several kinds \(6 .csv, 1 .mat\)"),
        (add_deeper, "several depths, such as .*'more/S1_gain_1.csv'"),
        (two_keys, "two labels of the subject, 'S1' and 'S2'"),
        (only_numbers, r"do not say which part .* part 1 is '1', '2'. Give the pattern"),
        (no_files, "has no file that can be read"),
    ],
)
def test_unclear_folders(folder, change, message):
    change(folder)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_experiment(folder, **NAMED)


def test_named_columns(folder):
    with pytest.raises(ValueError, match="There is no column 'who'"):
        read_experiment(folder, subject="who", **NAMED)
    with pytest.raises(ValueError, match=r"pattern has \{run\}, and run='u'"):
        read_experiment(f"{folder}/{{subject}}_gain_{{run}}.csv", run="u", **NAMED)
    with pytest.raises(ValueError, match="stands alone"):
        read_experiment([f"{folder}/{{subject}}.csv"], **NAMED)
    with pytest.raises(ValueError, match="named twice"):
        read_experiment([folder / "S1_gain_1.csv"] * 2, **NAMED)
    with pytest.raises(ValueError, match="dims names the dimensions of arrays"):
        read_experiment(folder, dims=("time", "run"), **NAMED)


@pytest.mark.parametrize(
    ("e", "u", "dims", "message"),
    [
        ((5, 40, 3), (5, 40, 3), None, r"\(5, 40, 3\): the first dimension is not the longest"),
        ((40, 5, 3), (40, 5), None, "is a matrix of 5 channels"),
        ((40, 5, 3), (40, 5, 3), ("time", "run"), "have 3 dimensions"),
        ((40, 5), (40, 5), ("rows", "time"), "each dimension once"),
        ((40, 5), (40, 5), {"time": None, "run": ["a"]}, "1 labels of the run.* have 5"),
        ((40, 5), (40, 5), {"time": None, "run": ["a"] * 5}, "not different"),
        ((40, 5), (40, 5), "time", "must be names"),
    ],
)
def test_arrays(tmp_path, e, u, dims, message):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "all.npz", e=rng.standard_normal(e), u=rng.standard_normal(u))
    with pytest.raises((ValueError, TypeError), match=message):
        read_experiment(tmp_path / "all.npz", inputs="e", output="u", dt=0.01, dims=dims)


def test_npz_of_objects_or_of_nothing(tmp_path):
    np.savez(tmp_path / "a.npz", e=np.array([{}], dtype=object), u=np.zeros(3))
    with pytest.raises(ValueError, match="'e' cannot be read: Object arrays"):
        read_experiment(tmp_path / "a.npz", inputs="e", output="u", dt=0.01)
    (tmp_path / "b.npz").write_bytes(b"hello")
    with pytest.raises(ValueError, match=r"b.npz cannot be read as a NumPy archive"):
        read_experiment(tmp_path / "b.npz", inputs="e", output="u", dt=0.01)


def test_a_struct_without_a_channel(tmp_path):
    own = {"e": np.zeros((40, 2)), "u": np.zeros((40, 2))}
    savemat(tmp_path / "all.mat", {"S1": own, "S2": {"e": own["e"]}})
    with pytest.raises(ValueError, match=r"no variable 'u'.*of its struct 'S2'"):
        read_experiment(tmp_path / "all.mat", inputs="e", output="u", dt=0.01)


def test_bids_without_a_rate(tmp_path):
    write_bids_motion(tmp_path, *experiment())
    beside = min(tmp_path.rglob("*_motion.json"))
    beside.write_text("{}")
    with pytest.raises(ValueError, match="should have a SamplingFrequency in Hz; it has None"):
        read_experiment(tmp_path)
    beside.unlink()
    with pytest.raises(ValueError, match="There is no sampling frequency"):
        read_experiment(tmp_path)


@pytest.mark.parametrize("header", ["t [ms]", "time_ms"])
def test_a_clock_is_converted_where_its_header_says_so(tmp_path, header):
    runs = list(each_run(*experiment()))
    for number, ((s, c, r), run) in enumerate(runs):
        if number in (0, 5):
            run = run.assign(t=1000 * run["t"]).rename(columns={"t": header})
        run.to_csv(tmp_path / f"{s}_{c}_{r}.csv", index=False)
    X, _ = read_experiment(tmp_path)
    time = X.index.get_level_values("time")
    assert time.max() == pytest.approx(0.59)


@pytest.mark.parametrize("number", [0, 5])
def test_a_clock_without_a_unit_is_read_as_it_is(tmp_path, number, capsys):
    runs = list(each_run(*experiment()))
    for k, ((s, c, r), run) in enumerate(runs):
        run = run.assign(t=1000 * run["t"]) if k == number else run
        run.to_csv(tmp_path / f"{s}_{c}_{r}.csv", index=False)
    X, _ = read_experiment(tmp_path)
    key = runs[number][0]
    assert X.xs(key, level=[0, 1, 2]).index[1] == pytest.approx(10.0)
    assert X.xs(runs[1][0], level=[0, 1, 2]).index[1] == pytest.approx(0.01)
    assert ("all are read as s" in capsys.readouterr().out) == (number == 0)


def test_a_session_is_put_before_the_run(tmp_path):
    for session in ("a", "b"):
        (tmp_path / f"sub-1_ses-{session}_task-x_run-1.csv").write_text(ROWS)
        (tmp_path / f"sub-2_ses-{session}_task-x_run-1.csv").write_text(ROWS)
    X, _ = read_experiment(tmp_path, **NAMED)
    assert list(X.index.unique("run")) == ["a-1", "b-1"]
    assert list(X.index.unique("condition")) == ["x"]


def test_a_list_keeps_its_order(folder):
    files = [folder / "S2_gain_3.csv", folder / "S1_gain_1.csv"]
    X, _ = read_experiment(files, **NAMED)
    assert X.index.droplevel("time").unique().tolist() == [("S2", "3"), ("S1", "1")]
