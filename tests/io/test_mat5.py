"""MAT 5 files: what SciPy reads is read, and what would end Python in SciPy is refused."""

import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import scipy.io.matlab
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat, savemat
from scipy.io.matlab import MatlabObject
from scipy.sparse import csc_array
from support import mat5
from support.mat5 import array, doubles, element, integers, packed

from skhoid import read_runs
from skhoid.io import matlab as _mat5
from skhoid.io.matlab import checked

NUMBERS = np.arange(6.0).reshape(2, 3)
VARIABLES = {
    "double": NUMBERS,
    "single": NUMBERS.astype(np.float32),
    "complex": NUMBERS + 1j,
    "complex_single": (NUMBERS + 1j).astype(np.complex64),
    **{str(dtype): NUMBERS.astype(dtype) for dtype in (*"bhilBHIL", bool)},
    "scalar": 3,
    "empty": np.zeros((0, 3)),
    "cube": np.ones((2, 3, 4)),
    "text": "one",
    "texts": np.array(["one", "three"]),
    "no_text": "",
    "greek": "λμ",
    "sparse": csc_array(NUMBERS),
    "sparse_logical": csc_array(NUMBERS > 2),
    "sparse_complex": csc_array(NUMBERS * 1j),
    "sparse_empty": csc_array((3, 2)),
    "cell": np.array([NUMBERS, "two", np.array([1, "b"], dtype=object)], dtype=object),
    "no_cells": np.zeros((0, 0), dtype=object),
    "struct": {"a": NUMBERS, "b": {"c": "text", "d": {"e": NUMBERS}}, "n": np.zeros((0, 0))},
    "structs": np.array([(1.0, "a"), (2.0, "b")], dtype=[("p", object), ("q", object)]),
    "no_fields": {},
    "object": MatlabObject(np.array([[(NUMBERS,)]], dtype=[("expr", object)]), "iddata"),
}
SHIPPED = sorted(Path(scipy.io.matlab.__file__).parent.glob("tests/data/*.mat"))
SIX = doubles(*range(6))
NO_TEXT = element(mat5.INT8, b"")
FIELD = integers(8) + element(mat5.INT8, b"field\0\0\0")
DEEP = element(mat5.ARRAY, b"")
for _ in range(101):
    DEEP = array(mat5.CELL, (1, 1), DEEP)
WRONG = {
    "type 0 of numbers": array(mat5.DOUBLE, (2, 3), element(0, bytes(48))),
    "type 8 of numbers": array(mat5.DOUBLE, (2, 3), element(8, bytes(48))),
    "type 25 of numbers": array(mat5.DOUBLE, (2, 3), element(25, bytes(48))),
    "type of small numbers": array(mat5.DOUBLE, (1, 1), b"\x0a\0\4\0" + bytes(4)),
    "type of imaginary parts": array(mat5.COMPLEX_DOUBLE, (2, 3), SIX + element(10, bytes(48))),
    "type of sparse rows": array(mat5.SPARSE, (2, 3), element(8, bytes(8))),
    "type of text": array(mat5.CHAR, (1, 3), element(8, b"abc")),
    "type of a name": array(mat5.DOUBLE, (2, 3), SIX).replace(element(1, b"x"), element(9, b"x")),
    "type of a shape": array(mat5.DOUBLE, (2, 3), SIX).replace(b"\5\0\0\0\x08", b"\7\0\0\0\x08"),
    "type of a cell": array(mat5.CELL, (1, 1), element(9, bytes(8))),
    "type of a variable": element(9, bytes(48)),
    "more numbers than bytes": array(mat5.DOUBLE, (3, 3), SIX),
    "fewer numbers than bytes": array(mat5.DOUBLE, (1, 3), SIX),
    "one imaginary part": array(mat5.COMPLEX_DOUBLE, (2, 3), SIX + doubles(1)),
    "size of numbers": array(mat5.DOUBLE, (2, 3), b"\x09\0\0\0\xf8\xff\xff\xff" + bytes(48)),
    "size of small numbers": array(mat5.DOUBLE, (1, 1), b"\x02\0\5\0" + bytes(8)),
    "parts too long": array(mat5.DOUBLE, (2, 3), SIX + bytes(8)),
    "parts too short": element(mat5.ARRAY, array(mat5.DOUBLE, (2, 3), SIX)[8:-8]),
    "ends after flags": element(mat5.ARRAY, element(6, b"\6\0\0\0\0\0\0\0")),
    "a size of nothing": element(mat5.ARRAY, b""),
    "class 0": array(0, (2, 3), SIX),
    "class 18": array(18, (2, 3), SIX),
    "a negative shape": array(mat5.CELL, (-1, -1), element(mat5.ARRAY, b"")),
    "no shape": array(mat5.DOUBLE, (), SIX),
    "33 dimensions": array(mat5.DOUBLE, (1,) * 33, doubles(1)),
    "many cells": array(mat5.CELL, (2**28, 1), b""),
    "many structs": array(mat5.STRUCT, (2**28, 1), FIELD),
    "many structs without fields": array(mat5.STRUCT, (2**28, 1), integers(8) + NO_TEXT),
    "much text": array(mat5.CHAR, (2**14, 2**14), NO_TEXT),
    "a cell longer than its array": array(mat5.CELL, (1, 1), b"\x0e\0\0\0\0\1\0\0" + bytes(80)),
    "names of fields of no length": array(mat5.STRUCT, (1, 1), FIELD.replace(b"\x08", b"\0")),
    "names of fields of length 1": array(mat5.STRUCT, (0, 0), integers(1) + element(1, b"a" * 99)),
    "two lengths of names": array(mat5.STRUCT, (0, 0), integers(8, 8) + FIELD[16:]),
    "deep cells": DEEP,
}  # fmt: skip


def read(path):
    content = {}
    for part in checked(path):
        content |= loadmat(part)
    return content


def same(left, right):
    assert list(left) == list(right)
    for name in left:
        assert type(left[name]) is type(right[name])
        assert repr(left[name]) == repr(right[name])


@pytest.mark.parametrize("do_compression", [False, True])
@pytest.mark.parametrize("oned_as", ["row", "column"])
@pytest.mark.parametrize("most", [0, 2**20])
def test_what_scipy_writes(tmp_path, monkeypatch, do_compression, oned_as, most):
    monkeypatch.setattr(_mat5, "_MOST_AT_ONCE", most)
    path = tmp_path / "run.mat"
    savemat(path, VARIABLES, do_compression=do_compression, oned_as=oned_as)
    same(read(path), loadmat(path))


@pytest.mark.skipif(not SHIPPED, reason="SciPy is installed without its tests")
@pytest.mark.filterwarnings("ignore")
def test_what_other_programs_wrote():
    n_read = 0
    for path in SHIPPED:
        try:
            expected = loadmat(path)
        except Exception:
            with pytest.raises(Exception, match=r"\w"):
                read(path)
            continue
        same(read(path), expected)
        n_read += 1
    assert n_read > 90


def test_packed_and_plain_variables_in_one_file(tmp_path):
    path = tmp_path / "run.mat"
    plain, opaque = array(mat5.DOUBLE, (2, 3), SIX, b"a"), mat5.opaque(b"d", b"iddata")
    path.write_bytes(mat5.HEADER + plain + packed(array(mat5.DOUBLE, (2, 3), SIX, b"b")) + opaque)
    content = read(path)
    np.testing.assert_array_equal(content["a"], NUMBERS.reshape(3, 2).T)
    np.testing.assert_array_equal(content["b"], content["a"])


def test_what_is_right_and_rare(tmp_path):
    path = tmp_path / "run.mat"
    big = array(mat5.DOUBLE, (2, 3), doubles(*range(6), order=">"), order=">")
    path.write_bytes(mat5.BIG_ENDIAN + big)
    assert read(path)["x"].tolist() == [[0, 2, 4], [1, 3, 5]]
    text = array(mat5.CHAR, (1, 3), element(mat5.INT8, b"abc"))
    rare = {
        "blanks without bytes": array(mat5.CHAR, (1, 3), NO_TEXT),
        "structs without fields": array(mat5.STRUCT, (2, 1), integers(8) + NO_TEXT),
        "no last padding": mat5.unpadded(mat5.ARRAY, text[8:-5]),
        "a stream without its end": mat5.unpadded(mat5.PACKED, zlib.compress(text)[:-4]),
    }
    for what, variable in rare.items():
        path.write_bytes(mat5.HEADER + variable)
        same(read(path), loadmat(BytesIO(mat5.HEADER + variable)))
        assert "x" in read(path), what


@pytest.mark.parametrize("pack", [bytes, packed])
@pytest.mark.parametrize("what", WRONG)
def test_what_would_end_python(tmp_path, what, pack):
    path = tmp_path / "run.mat"
    path.write_bytes(mat5.HEADER + pack(WRONG[what]))
    message = r"run\.mat cannot be read as a MATLAB file: it is damaged at .*Use another copy"
    with pytest.raises(ValueError, match=message):
        read_runs(path, inputs="x", output="y", dt=0.01)


def test_the_variable_is_named(tmp_path):
    path = tmp_path / "run.mat"
    good = array(mat5.DOUBLE, (2, 3), SIX, b"good")
    cell = array(mat5.DOUBLE, (2, 2), SIX, b"")
    for pack in (bytes, packed):
        path.write_bytes(mat5.HEADER + pack(good) + pack(array(mat5.CELL, (1, 1), cell, b"bad")))
        with pytest.raises(
            ValueError, match=r"'bad': 48 bytes hold no numbers of the shape \(2, 2"
        ):
            read_runs(path, inputs="x", output="y", dt=0.01)


@pytest.mark.parametrize(
    "parts",
    [
        integers(0, 2**30) + integers(0, 1, 2) + doubles(1, 2),
        integers(0, -(2**28)) + integers(0, 1, 2) + doubles(1, 2),
        integers(0, 1) + integers(0, 2**28, 2) + doubles(1, 2),
    ],
)
def test_sparse_numbers_at_places_that_are_not_there(tmp_path, parts):
    path = tmp_path / "run.mat"
    vector = array(mat5.DOUBLE, (3, 1), doubles(1, 2, 3), b"u")
    path.write_bytes(mat5.HEADER + array(mat5.SPARSE, (3, 2), parts) + vector)
    with pytest.raises(ValueError, match=r"run\.mat cannot be read .*at its variable 'x'"):
        read_runs(path, inputs="x", output="u", dt=0.01)


def test_an_object_whose_name_is_damaged(tmp_path):
    path = tmp_path / "run.mat"
    path.write_bytes(mat5.HEADER + mat5.opaque(b"\xee", b"iddata"))
    with pytest.raises(ValueError, match=r"run\.mat has no variable 'x'.*which is a MATLAB object"):
        read_runs(path, inputs="x", output="y", dt=0.01)


def test_a_packed_variable_that_is_larger_than_it_says(tmp_path):
    path = tmp_path / "run.mat"
    bomb = element(mat5.ARRAY, bytes(2**26))
    path.write_bytes(mat5.HEADER + packed(bomb.replace(b"\4", b"\0", 1)))
    with pytest.raises(ValueError, match="damaged at its byte 128"):
        list(checked(path))


RICH = BytesIO()
savemat(RICH, VARIABLES)
PACKED = BytesIO()
savemat(PACKED, VARIABLES, do_compression=True)


@settings(max_examples=200)
@given(content=st.sampled_from([RICH, PACKED]).flatmap(lambda f: mat5.wrong_words(f.getvalue())))
@pytest.mark.filterwarnings("ignore")
def test_wrong_words(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("words") / "run.mat"
    path.write_bytes(content)
    try:
        read_runs(path, inputs="sparse", output="double", dt=0.01)
    except ValueError as error:
        message = str(error)
    else:
        message = "run.mat"
    assert "run.mat" in message
