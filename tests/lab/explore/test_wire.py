"""The envelope: what goes in comes out, compact arrays to the accuracy that is promised."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support.envelopes import unpack_text

from skhoid.lab.explore import payloads as wire

FLOATS = st.floats(allow_nan=True, allow_infinity=False, width=64)
BOUNDED = st.floats(-1e6, 1e6, allow_nan=False)
SHAPE = st.integers(0, 40)


@given(arrays(float, SHAPE, elements=FLOATS), arrays(bool, SHAPE))
def test_arrays_come_back_bit_for_bit(values, marks):
    back = wire.unpack(wire.pack({"a": [values, {"b": marks}]}))
    np.testing.assert_array_equal(back["a"][0], values)
    np.testing.assert_array_equal(back["a"][1]["b"], marks)
    assert back["a"][1]["b"].dtype == np.uint8


@given(arrays(float, SHAPE, elements=BOUNDED), st.sets(st.integers(0, 39)))
def test_compact_arrays_are_exact_to_a_part_in_65533_of_their_range(values, missing):
    values[[i for i in missing if i < values.size]] = np.nan
    back = unpack_text(wire.pack_text(values))
    np.testing.assert_array_equal(np.isnan(back), np.isnan(values))
    known = values[~np.isnan(values)]
    if known.size:
        size = np.abs(known).max()
        error = np.nanmax(np.abs(back - values))
        assert error <= np.ptp(known) / 65_533 / 2 * (1 + 1e-9) + 1e-12 * size


@pytest.mark.parametrize(
    ("given", "back"),
    [
        (None, None),
        (float("nan"), None),
        (float("inf"), None),
        (np.float64(1.5), 1.5),
        (np.int64(3), 3),
        (True, True),
        ("</script> \u202e é 😀", "</script> \u202e é 😀"),
        ({1: (2, [3])}, {"1": [2, [3]]}),
    ],
)
def test_plain_values(given, back):
    assert wire.unpack(wire.pack(given)) == back


def test_every_array_begins_at_a_multiple_of_eight():
    value = [np.ones(3, dtype=bool), np.arange(4.0), np.zeros(1, dtype=bool), np.arange(2.0)]
    envelope = wire.pack(value)
    length = int.from_bytes(envelope[:4], "little")
    offsets = [a["offset"] for a in json.loads(envelope[4 : 4 + length])["arrays"]]
    assert [offset % 8 for offset in offsets] == [0] * 4
    for one, other in zip(wire.unpack(envelope), value, strict=True):
        np.testing.assert_array_equal(one, other)


def test_text_is_safe_in_a_page():
    text = wire.pack_text({"name": "</script><script>alert(1)</script>", "a": np.arange(5.0)})
    assert set(text) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/=")
