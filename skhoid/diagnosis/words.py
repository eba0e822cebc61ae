"""What findings mean in words for a person, and for a machine."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Words:
    """Meanings of findings, one for each kind."""

    lost_control: str
    outlying_run: str
    learning: str
    bias: str
    level: str
    outlier: str
    change: str
    power_change: str
    mean_change: str
    range: str
    asymmetry: str
    follows_target: str
    follows_disturbance: str


WORDS = {
    "human": Words(
        lost_control="A person who has lost control no longer responds as before.",
        outlying_run="Another person, a practice run, fatigue, or a setting that was changed.",
        learning="The person is still learning (falling) or tiring (growing) from run to run.",
        bias="An offset of the recording, a trim of the stick, or integral action.",
        level="A stop of the stick, a limit of the recording, or a level the person returns to.",
        outlier="A slip of the hand, a spike or a gap of the recording, or an onset that the "
        "model does not have.",
        change="The person's parameters change within the run; the model's do not, or not as much.",
        power_change="Effort or workload change, or the remnant's gain follows the person's own.",
        mean_change="A bias that drifts or steps: posture, trim, or an offset of the recording.",
        range="check the stick's range",
        asymmetry="Left and right differ: the arm, the stick, or an offset.",
        follows_target="On a pursuit or preview display: feedforward from the target. On a "
        "compensatory display the person does not see the target, so it can only be precognition, "
        "a linear misfit of the response to e, or something equivalent to it.",
        follows_disturbance="The person, or the stick, responds to the disturbance along a path "
        "that does not go through e: motion, force, or vibration.",
    ),
    "machine": Words(
        lost_control="Beyond a stop or a limit, or after a fault, it no longer responds as before.",
        outlying_run="Another setting, load or temperature, a fault, or another initial state.",
        learning="It warms up, wears, or drifts from run to run.",
        bias="An offset of the recording or the actuator, a constant load, or integral action.",
        level="A stop, a limit of the actuator or of the recording, or a level at which it rests.",
        outlier="A shock, a spike or a gap of the recording, or an onset that the model does not "
        "have.",
        change="Gain or dynamics change within the run; the model's do not, or not as much.",
        power_change="The noise depends on time or on the operating point.",
        mean_change="A load or an offset that drifts or steps.",
        range="check the range of actuator and sensor",
        asymmetry="The two directions differ: friction, geometry, or an offset.",
        follows_target="Feedforward from the reference, or a linear misfit of the response to the "
        "input.",
        follows_disturbance="The disturbance acts on the output along a path that the model lacks.",
    ),
}
