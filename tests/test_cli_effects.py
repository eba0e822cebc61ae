"""The commands about missing effects, and effects in the simulated loop."""

import json

import numpy as np
import pytest

from skhoid import (
    ARXRegressor,
    CompensatoryTask,
    EffectSearchCV,
    OperatorRegressor,
    make_tracking_runs,
    write_runs,
)
from skhoid.cli import main
from skhoid.diagnosis.story import HIDDEN, Story
from skhoid.effects import Bias, DeadZone, Effect, GainDrift, Intermittent, Parameter, Preview

SHORT = {"n_runs": 3, "duration": 40.96, "sampling_rate": 50, "channels": ["e", "x", "f_t"]}


def run_json(capsys, *words):
    assert main([*words, "--json", "--no-pictures"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def biased_runs():
    return make_tracking_runs(
        "C1", remnant_intensity=0.05, random_state=1, effects=Bias(level=0.1), **SHORT
    )


@pytest.fixture
def run_file(tmp_path, biased_runs):
    """Three runs in one file whose channels have names of their own."""
    X, y = biased_runs
    renamed = X.rename(columns={"e": "error", "x": "angle", "f_t": "wanted"})
    path = tmp_path / "runs.csv"
    write_runs(renamed, y.rename("stick"), path)
    return str(path)


WORDS = ["--input", "error", "--x", "angle", "--target", "wanted", "--output", "stick"]
WORDS += ["--time", "time", "--run", "run", "--effects", "bias", "drift", "saturation"]


# Effects in the loop


@pytest.mark.parametrize("condition", ["C1", "C4"])
def test_an_effect_that_does_nothing_leaves_the_loop_as_it_is(condition):
    options = {**SHORT, "remnant_intensity": 0.1, "random_state": 0, "sampling_rate": 100}
    X, y = make_tracking_runs(condition, run_in=20.0, **options)
    X_same, y_same = make_tracking_runs(condition, effects=GainDrift(rate=0.0), **options)
    # The kernel holds the target over a step, the simulation of effects is linear between samples.
    assert 1 - ((y - y_same) ** 2).sum() / (y**2).sum() > 0.998
    assert np.corrcoef(X["e"], X_same["e"])[0, 1] > 0.999


def test_the_loop_is_closed():
    X, y = make_tracking_runs("C1", effects=DeadZone(width=0.3), **SHORT)
    np.testing.assert_allclose(X["e"], X["f_t"] - X["x"], atol=1e-12)
    model = OperatorRegressor(effects=DeadZone()).fit(X, y)
    truth = {"K_e": 0.09, "T_L": 0.4, "tau_e": 0.28, "omega_nm": 11.25, "dead_zone__width": 0.3}
    found = model.parameters_["value"]
    assert {name: found[name] for name in truth} == pytest.approx(truth, rel=0.03)
    assert model.vaf_ > 99.9


def test_an_offset_is_integrated_away():
    X, y = make_tracking_runs("C1", run_in=40.0, **SHORT)
    X_b, y_b = make_tracking_runs("C1", run_in=40.0, effects=Bias(level=0.1), **SHORT)
    # The controlled element integrates, so that in the end the error makes up for the offset.
    assert (y_b - y).mean() == pytest.approx(0.0, abs=2e-3)
    assert (X_b["e"] - X["e"]).mean() == pytest.approx(-0.1 / 0.09, rel=0.02)


def test_runs_with_effects_do_not_depend_on_their_number():
    options = {"remnant_intensity": 0.1, "random_state": 3, "effects": DeadZone(width=0.3)}
    _, y = make_tracking_runs("C1", **{**SHORT, "n_runs": 1}, **options)
    _, y_more = make_tracking_runs("C1", **SHORT, **options)
    np.testing.assert_allclose(y_more.loc[[0]], y, atol=1e-7)


def test_own_effects_and_those_that_look_ahead_are_simulated():
    class Half(Effect):
        name = "half"
        place = "output"
        parameters = (Parameter("factor"),)

        def __init__(self, *, factor=None):
            self.factor = factor

        def apply(self, signal, record, factor):
            return factor * signal

    _, y = make_tracking_runs("C1", effects=Half(factor=0.5), **SHORT)
    _, y_gain = make_tracking_runs("C1", perturbation={"K_e": -0.045, "K_edot": -0.018}, **SHORT)
    assert 1 - ((y - y_gain) ** 2).sum() / (y**2).sum() > 0.998
    effect = Preview(gain=0.5, time=0.4)
    X, y = make_tracking_runs("C1", effects=effect, **SHORT)
    model = OperatorRegressor(effects="preview").fit(X, y)
    assert model.parameters_.loc["preview__time", "value"] == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effects": DeadZone()}, r"needs numbers to be simulated: DeadZone\(width=\)"),
        ({"effects": "tremor"}, "tremor is noise"),
        ({"effects": HIDDEN["bias"], "display": 0.5}, "the display is 'compensatory'"),
        ({"effects": Intermittent(hold_time=0.3)}, "needs numbers"),
    ],
)
def test_what_cannot_be_simulated_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        make_tracking_runs("C1", **SHORT, **options)


def test_effects_need_an_operator_of_physics():
    X, y = make_tracking_runs("C1", **SHORT)
    model = ARXRegressor(nk=15, inputs=["e"]).fit(X, y)
    with pytest.raises(ValueError, match="effects are those of a HumanOperator"):
        CompensatoryTask(operator=model, effects=Bias(level=0.1), sampling_rate=50)


# The story


def test_story_names_what_is_hidden_with_numbers_at_each_step(biased_runs):
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", "drift", "dead_zone"])
    story = Story(search, *biased_runs)
    told = "\n".join(story.tell())
    path = story.search_.error_path_
    assert story.search_.best_effects_ == ["bias"]
    for expected in (
        "Measured: 3 runs, 6144 rows at 50 Hz, 123 s in all",
        "input e (deg), output u (deg); channels that effects may use: x (deg), f_t (deg)",
        f"explains a VAF of {story.comparison_.vaf:.1f} %",
        f"can reach {story.comparison_.noise_ceiling:.1f} %",
        f"bias is added: VAF {path['vaf'][0]:.1f} -> {path['vaf'][1]:.1f} %",
        "Verdict: effects found",
    ):
        assert expected in told
    assert told.index("Search, step 1") < told.index("bias is added") < told.index("step 2")
    assert json.loads(json.dumps(story.as_dict()["parameters"]))[-1]["parameter"] == "bias__level"


# The commands


def test_demo_finds_what_it_hides(capsys):
    words = ["--runs", "3", "--effect", "bias", "--effects", "bias", "drift"]
    found = run_json(capsys, "demo", *words)
    assert found["hidden"] == found["best_effects"] == ["bias"]
    vaf = [step["vaf"] for step in found["error_path"]]
    assert vaf[1] - vaf[0] > 5
    assert vaf[1] == pytest.approx(found["truth_vaf"], abs=0.5)
    assert run_json(capsys, "demo", *words) == found  # the seed has a default


def test_demo_prints_the_story_and_the_truth_and_draws(capsys, tmp_path):
    words = ["--runs", "2", "--effect", "bias", "--effects", "bias", "--out", str(tmp_path)]
    assert main(["demo", *words]) == 0
    printed = capsys.readouterr().out
    for expected in ("Baseline:", "bias is added", "The truth: hidden bias", "bias__level: 0.05,"):
        assert expected in printed
    assert max(map(len, printed.splitlines())) <= 100 + len(str(tmp_path))
    names = {path.name for path in tmp_path.iterdir()}
    assert {"comparison.png", "ranking-1.png", "error-path.png", "bias.png"} <= names


def test_demo_with_nothing_hidden_says_so(capsys):
    words = ["--runs", "2", "--effect", "none", "--effects", "bias", "saturation"]
    found = run_json(capsys, "demo", *words)
    assert (found["verdict"], found["best_effects"]) == ("nothing is missing", [])


def test_diagnose_own_files(capsys, run_file):
    found = run_json(capsys, "diagnose", run_file, *WORDS)
    assert found["best_effects"] == ["bias"]
    assert (found["inputs"], found["output"], found["n_runs"]) == (["error"], "stick", 3)
    level = next(p for p in found["parameters"] if p["parameter"] == "bias__level")
    assert level["value"] == pytest.approx(0.1, abs=0.01)
    assert found["comparison"]["noise_ceiling"] > 90  # of the target, by its role


def test_diagnose_takes_delay_display_element_and_run_in(capsys, run_file):
    words = ["--delay", "0.28", "--display", "pursuit", "--controlled-element", "90", "6"]
    found = run_json(capsys, "diagnose", run_file, *WORDS, *words, "--run-in", "4")
    delay = next(p for p in found["baseline"] if p["parameter"] == "tau_e")
    assert delay["value"] == 0.28
    assert found["best_effects"] == ["bias"]


def test_diagnose_with_an_arx_core(capsys, run_file):
    found = run_json(capsys, "diagnose", run_file, *WORDS, "--core", "arx", "--nk", "15")
    assert [p["parameter"] for p in found["baseline"]][:4] == ["a1", "a2", "b0", "b1"]
    assert found["best_effects"] == ["bias"]


def test_diagnose_the_bundled_recordings(capsys):
    found = run_json(capsys, "diagnose", "--effects", "dead_zone", "bias")
    assert (found["n_runs"], found["inputs"], found["units"]["x"]) == (4, ["f_t"], "px")
    assert found["error_path"][0]["vaf"] > 90
    assert found["comparison"]["noise_ceiling"] > found["error_path"][0]["vaf"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["demo", "--effect", "dedd_zone"], "demo hides none, dead_zone"),
        (["diagnose", "nothing-here.csv", "--time", "t"], "nothing-here.csv"),
        (["diagnose", "run.csv"], "--time NAME, or --dt SECONDS"),
        (["diagnose", "run.csv", "--time", "t", "--role", "roll"], "--role takes NAME=ROLE"),
        (["diagnose", "--effects", "dedd_zone"], "No effect is called 'dedd_zone'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(capsys, words, message):
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("skhoid: error: ")
    assert message in printed.err
