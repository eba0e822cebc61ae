"""Names of files that come from a browser."""

import pytest

from skhoid.lab.workbench.session import LONGEST_NAME, free_name, safe_name


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("run1.csv", "run1.csv"),
        ("My run (2).CSV", "My_run_2.csv"),
        ("../../etc/passwd.csv", "passwd.csv"),
        ("..\\..\\boot.txt", "boot.txt"),
        ("C:\\data\\a.mat", "a.mat"),
        ("/etc/cron.d/x.csv", "x.csv"),
        (".csv", "file.csv"),
        ("....csv", "file.csv"),
        ("con.csv", "file-con.csv"),
        ("nul.tar.csv", "file-nul.tar.csv"),
        ("a\x00b\n.csv", "a_b.csv"),
        ("<img src=x>.csv", "img_src_x.csv"),
        ("données.csv", "données.csv"),
        ("*?[a].csv", "a.csv"),
        ("-rf.csv", "rf.csv"),
    ],
)
def test_names_are_made_safe(name, safe):
    assert safe_name(name) == safe


def test_long_names_are_cut():
    assert safe_name("a" * 1000 + ".csv") == "a" * LONGEST_NAME + ".csv"


@pytest.mark.parametrize("name", ["", "a", "a.exe", "a.csv/", "a.csv\x00.sh", "session.json", ".."])
def test_other_files_are_refused_with_what_can_be_read(name):
    with pytest.raises(ValueError, match=r"cannot be read: .*\.csv"):
        safe_name(name)


def test_a_name_that_is_taken_gets_a_number():
    assert free_name("a.csv", set()) == "a.csv"
    assert free_name("a.csv", {"a.csv", "a-2.csv"}) == "a-3.csv"
