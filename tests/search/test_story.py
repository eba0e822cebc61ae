"""The way from measured runs to named effects, in words."""

import json

import pytest
from support.shapes import Fechner, a_shape, nothing_near

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone
from skhoid.search.story import Story, shape_tables


def recorded(effects, n_runs=3, remnant=0.05):
    return make_tracking_runs(
        "C1",
        n_runs=n_runs,
        duration=40.96,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=remnant,
        random_state=1,
        effects=effects,
    )


@pytest.fixture(scope="module")
def biased():
    return recorded(Bias(level=0.1))


def test_story_names_what_is_hidden_with_numbers_at_each_step(biased):
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", "drift", "dead_zone"])
    story = Story(search, *biased)
    told = "\n".join(story.tell())
    path, ceiling = story.search_.error_path_, story.comparison_.noise_ceiling
    assert story.search_.best_effects_ == ["bias"]
    for expected in (
        "Measured: 3 runs, 6144 rows at 50 Hz, 123 s in all",
        "input e (deg), output u (deg); channels that effects may use: x (deg), f_t (deg)",
        f"on the rows of its fit it has a VAF of {story.comparison_.vaf:.1f} %",
        f"noise ceiling on these rows, judged by this model: {ceiling:.1f} %",
        f"with bias: held-out VAF {path['vaf'][0]:.1f} -> {path['vaf'][1]:.1f} %",
        "Verdict: effects found: bias",
        "p < 1e-6",
    ):
        assert expected in told
    assert told.index("Verdict") < told.index("step 1") < told.index("with bias: held-out")
    assert json.loads(json.dumps(story.as_dict()["parameters"]))[-1]["parameter"] == "bias__level"


@pytest.mark.slow
def test_the_ceiling_is_told_as_the_lower_bound_that_it_is():
    runs = recorded(DeadZone(width=0.3), n_runs=3, remnant=0.4)
    story = Story(EffectSearchCV(OperatorRegressor(), effects=["dead_zone"]), *runs)
    told = "\n".join(story.tell())
    assert story.comparison_.explainable_gap < 0
    assert story.search_.best_effects_ == ["dead_zone"]
    assert "nothing is left, within its error" in told
    assert story.comparison_.ceiling_note in told
    assert "Nothing is missing" not in told
    assert "points are left" not in told


@pytest.mark.slow
def test_one_effect_is_no_plural_and_what_was_not_tried_is_no_verdict(biased):
    search = EffectSearchCV(OperatorRegressor(), effects="dead_zone")
    told = "\n".join(Story(search, *biased).tell())
    assert "Search, step 1: 1 effect tried, judged" in told
    assert "Verdict: something is missing, not among the effects tried" in told
    assert "  what the only effect tried does not explain:" in told
    assert 'effects="all"' in told


@pytest.mark.slow
def test_held_out_rows_without_a_ceiling(biased):
    X, y = (part.loc[[0]] for part in biased)
    story = Story(EffectSearchCV(OperatorRegressor(), effects=["bias"]), X, y)
    told = list(story.tell())
    assert "Measured: 1 run, 2048 rows at 50 Hz, 41 s in all" in told
    why = story.search_.ceiling_note_
    assert "not periodic" in why
    unknown = f"  how much is left to explain is not known for held-out rows: {why}"
    assert unknown in told
    assert f"The noise ceiling is not known: {why}." in story.search_.summary()
    assert story.as_dict()["ceiling_note"] == why


def test_what_has_no_name_is_told_with_its_curve_and_the_names_near_it():
    curve, nearest = shape_tables(a_shape())
    assert curve.headings[-1] == "95 % band"
    assert len(curve.rows) == 9
    assert nearest.ids == ["cubic_gain", "dead_zone"]
    assert nearest.rows[1] == [
        "dead zone (gap)",
        "0.44",
        "not within",
        "width = 0.3 deg",
    ]
    assert [table.kind for table in shape_tables(a_shape(**nothing_near()))] == ["shape"]


@pytest.mark.slow
def test_a_story_ends_with_the_shape():
    X, y = make_tracking_runs(
        "C1", n_runs=4, remnant_intensity=0.1, random_state=0, effects=Fechner(knee=0.15)
    )
    story = Story(EffectSearchCV(OperatorRegressor(), effects=["bias"]), X, y)
    told = list(story.tell())
    shape = story.search_.shape_
    assert f"  {shape.sentences()[0]}" in told
    kinds = [block.kind for block in told if hasattr(block, "kind")]
    assert kinds[:3] == ["shape", "nearest", "parameters"]
    found = json.loads(json.dumps(story.as_dict()["shape"]))
    assert found["sentence"] == shape.sentence
    assert len(found["curve"]) == len(shape.curve)
