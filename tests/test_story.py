"""The way from measured runs to named effects, in words."""

import json

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.diagnosis.story import Story
from skhoid.effects import Bias


def test_story_names_what_is_hidden_with_numbers_at_each_step():
    runs = make_tracking_runs(
        "C1",
        n_runs=3,
        duration=40.96,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=1,
        effects=Bias(level=0.1),
    )
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", "drift", "dead_zone"])
    story = Story(search, *runs)
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
