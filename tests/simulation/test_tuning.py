"""The remnant gain that gives a wanted intensity: exact on its realisations, and Table G.1."""

import numpy as np
import pytest

from skhoid import (
    CompensatoryTask,
    HumanOperator,
    Remnant,
    RemnantIntensityError,
    Sigmoid,
    UnstableLoopError,
    tune_remnant,
)

TRANSITIONS = {"C4": ("C1", "C2"), "C5": ("C2", "C1")}


def wanting(condition, intensity=0.15, order=2, **options):
    remnant = Remnant(order=order, intensity=intensity)
    options.setdefault("run_in", 20.0)
    return CompensatoryTask.of_condition(condition, remnant=remnant, **options)


def white(task, n_runs=10, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n_runs, task.n_run_in + task.n_samples))


@pytest.mark.parametrize(
    ("condition", "order", "intensity"), [("C1", 1, 0.001), ("C2", 4, 0.05), ("C1", "nm", 0.20)]
)
def test_mean_intensity_of_the_same_realisations_is_exact(condition, order, intensity):
    task = wanting(condition, intensity, order)
    noise = white(task)
    tuned = tune_remnant(task, noise=noise)
    achieved = tuned.simulate(10, noise=noise).intensity()
    assert achieved.mean() == pytest.approx(intensity, rel=1e-9)
    assert achieved.std() > 0.01 * intensity


# Transitions


@pytest.mark.parametrize(("condition", "order"), [("C4", 1), ("C5", 3)])
def test_gain_follows_the_transition(condition, order):
    """From the gain of C1 to that of C2, on the same noise, by the sigmoid of the physics."""
    task = wanting(condition, 0.1, order)
    gain = tune_remnant(task, random_state=3).remnant.gain
    begin, end = (
        tune_remnant(wanting(state, 0.1, order), random_state=3).remnant.gain
        for state in TRANSITIONS[condition]
    )
    K_c = task.controlled_element.K_c
    assert isinstance(gain, Sigmoid)
    assert (gain.rate, gain.time) == (K_c.rate, K_c.time)
    assert gain.initial == pytest.approx(begin, rel=1e-6)
    assert gain.final == pytest.approx(end, rel=1e-6)
    assert gain(40.96) == pytest.approx((begin + end) / 2, rel=1e-6)


# What is refused


def test_fourth_order_remnant_cannot_reach_030_in_c2():
    """Table G.1 gives 0.339, which is ill-posed: P_n saturates at 0.30 (facts.json G1.Kn.H4)."""
    with pytest.raises(
        RemnantIntensityError, match=r"P_n tends to 0\.(2[89]|3[01])\d as K_n grows"
    ):
        tune_remnant(wanting("C2", 0.30, order=4, run_in=None), random_state=0)


def test_a_loop_that_is_unstable():
    with pytest.raises(UnstableLoopError, match="grows by a factor e every"):
        tune_remnant(wanting("C1", operator=HumanOperator(K_e=0.5)), random_state=0)


# Table G.1


@pytest.mark.parametrize(
    ("order", "condition", "intensity", "gain", "tolerance"),
    [  # G1.Kn.H<order>.<condition>.P<intensity>: reproduced_value, tolerance_recommended
        (1, "C1", 0.05, 0.005858168931659653, 0.0006),
        (1, "C2", 0.15, 0.02563982010171929, 0.00163),
        (2, "C1", 0.15, 0.01569850927295652, 0.00111),
        (2, "C2", 0.15, 0.03946590071688484, 0.00351),
        (4, "C1", 0.30, 0.0343930453283608, 0.00344),
        (4, "C2", 0.10, 0.03904390756885666, 0.00407),
        ("nm", "C1", 0.30, 0.01833331495550789, 0.00123),
        ("nm", "C2", 0.20, 0.0331991761159641, 0.00261),
    ],
)
def test_gains_of_table_g1(order, condition, intensity, gain, tolerance):
    """Ten realisations after seven windows of run-in, as in the thesis."""
    task = wanting(condition, intensity, order, run_in=None)
    found = tune_remnant(task, random_state=0).remnant.gain
    assert found == pytest.approx(gain, abs=tolerance)
