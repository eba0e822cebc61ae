"""What is said of a shape: sentences, tables, numbers."""

import json
import re

import pytest
from support.shapes import a_shape, nothing_near


def test_sentences_say_place_gain_names_and_what_to_do():
    first, names, record, sketch = a_shape().sentences()
    assert first == (
        "The shape of what has no name: it acts on the error, as a function of its size and sign; "
        "a curve with 9.7 effective degrees of freedom raises the held-out VAF by 9.9 points, "
        "98 % of what the baseline leaves to explain."
    )
    assert names == (
        "Nearest names: cubic gain (distance 0.21, within the band), dead zone (distance 0.44)."
    )
    assert record == "To tell cubic gain from dead zone, record more."
    assert sketch.endswith('search.sketch_effect("my_effect", "my_effect.py").')


def test_a_delay_beside_it_is_free_and_not_called_wrong():
    first = a_shape(beside=["wrong_delay"]).sentences()[0]
    assert "of what the model with a free delay leaves" in first
    first = a_shape(beside=["wrong_delay", "bias"]).sentences()[0]
    assert "of what the model with bias and a free delay leaves" in first


def test_where_no_name_is_near_none_is_said():
    shape = a_shape(**nothing_near())
    assert len(shape.sentences()) == 2
    assert "earest" not in shape.summary()


def test_far_names_are_not_called_near():
    nearest = a_shape().nearest.assign(distance=[0.71, 0.9])
    shape = a_shape(nearest=nearest)
    assert not shape.is_near
    assert shape.sentences()[1] == (
        "No effect of the catalogue comes near its curve; the nearest is cubic gain (distance "
        "0.71, within the band)."
    )
    some = a_shape(nearest=nearest.assign(distance=[0.69, 0.9]))
    assert some.sentences()[1] == "Nearest name: cubic gain (distance 0.69, within the band)."


def test_what_the_catalogue_misses_is_said_and_where_only_the_form_fails():
    told = a_shape(closest=["cubic_gain"], misses=0.4).sentences()
    assert told[1] == (
        "Of the catalogue, cubic gain explains most of the same, and misses 40 % of it."
    )
    told = a_shape(family="feedforward", closest=["feedforward"], misses=0.25).sentences()
    assert told[1] == "It acts where feedforward does; only the form is another."
    assert "feedforward explains most of the same, and misses 25 % of it." in told[2]
    assert a_shape(family="feedforward").as_dict()["family"] == "feedforward"


def test_the_summary_has_the_curve_and_the_names_in_tables():
    shape = a_shape()
    told = shape.summary()
    assert repr(shape) == told
    assert max(map(len, told.splitlines())) <= 88
    cells = [re.split(r"\s{2,}", line.strip()) for line in told.splitlines()]
    assert ["-2", "0.227", "0.177 to 0.277"] in cells
    assert ["dead zone (gap)", "0.44", "not within", "width = 0.3 deg"] in cells
    assert "<table" in shape._repr_html_()
    assert [table.kind for table in a_shape(**nothing_near()).tables()] == ["shape"]


def test_json_has_all_of_it():
    found = json.loads(json.dumps(a_shape().as_dict()))
    assert found["id"] == "free_map"
    assert found["closed"] == pytest.approx(0.984)
    assert found["curve"][0] == pytest.approx(
        {"at": -2, "value": 0.227, "low": 0.177, "high": 0.277}, abs=1e-3
    )
    assert [row["effect"] for row in found["nearest"]] == ["cubic_gain", "dead_zone"]
