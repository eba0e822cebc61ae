"""RecursiveARX cannot be broken: pauses, dead channels, scales, missing values, long streams."""

import numpy as np
import pytest
from scipy.signal import lfilter
from support.recursion_twin import recursive
from support.synthetic import NK, A, B

from skhoid import RecursiveARX

BEFORE, PAUSE, AFTER = 1500, 16_000, 1500
FORGETTING = {
    "number": {"forgetting": 0.95},
    "matrix": {"forgetting": (0.95, 0.96, 0.97, 0.95)},
    "diagonal": {"forgetting": 0.95, "forgetting_form": "diagonal"},
}
SHORT = {
    "half of the matrix": {"forgetting": (0.5, 1.0, 0.5, 0.9)},
    "variable": {"forgetting": "variable", "memory_horizon": 20},
    "auto": {"forgetting": "auto"},
    "none": {},
}
each_forgetting = pytest.mark.parametrize("params", FORGETTING.values(), ids=FORGETTING.keys())
any_forgetting = pytest.mark.parametrize(
    "params", [*FORGETTING.values(), *SHORT.values()], ids=[*FORGETTING, *SHORT]
)

pytestmark = [pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning"), pytest.mark.slow]


def respond(e, white):
    """Output of the system of ``synthetic.py``, from rest."""
    numerator = np.concatenate([np.zeros(NK), B])
    return lfilter(numerator, [1, *A], e) + lfilter([1], [1, *A], white)


def assert_sound(model, *, excited=False):
    """Finite, and every P exactly symmetric and positive definite, or to rounding.

    The product P of positive factors is rounded itself: without excitation its condition number
    comes near 1 / eps, so that the smallest eigenvalue is not known from it.
    """
    assert np.isfinite(model.coef_path_).all()
    assert np.isfinite(model.noise_variance_)
    P = model.covariance_path_
    assert np.isfinite(P).all()
    np.testing.assert_array_equal(P, P.swapaxes(-1, -2))
    if model.noise_variance_ == 0:
        return
    scale = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    assert (scale > 0).all()
    correlation = P / scale[..., None] / scale[..., None, :]
    if excited:
        np.linalg.cholesky(correlation)
    else:
        assert np.linalg.eigvalsh(correlation).min() > -1e-13


# Pauses


def paused(kind, seed=0):
    """Input and output around a pause, and those of the run that was never paused."""
    rng = np.random.default_rng(seed)
    n = BEFORE + AFTER
    e, white = rng.standard_normal(n), 0.01 * rng.standard_normal(n)
    tiny = rng.standard_normal((2, PAUSE))
    inside = {
        "zeros": (np.zeros(PAUSE), np.zeros(PAUSE)),
        "constants": (np.full(PAUSE, 0.7), np.zeros(PAUSE)),
        "tiny noise": (1e-9 * tiny[0], 1e-9 * tiny[1]),
        "missing": (np.zeros(PAUSE), np.zeros(PAUSE)),
    }[kind]
    parts = zip((e, white), inside, strict=True)
    rows = [np.concatenate([a[:BEFORE], b, a[BEFORE:]]) for a, b in parts]
    with_pause = rows[0], respond(*rows)
    if kind == "missing":
        with_pause[1][BEFORE : BEFORE + PAUSE] = np.nan
        with_pause[0][BEFORE : BEFORE + PAUSE] = np.nan
    return with_pause, (e, respond(e, white))


PAUSES = ["zeros", "constants", "tiny noise", "missing"]


@each_forgetting
@pytest.mark.parametrize("kind", PAUSES)
def test_pause(kind, params):
    """Within 1 % of the run that was never paused, 3 N0 after the pause and from then on."""
    (e, u), (e_never, u_never) = paused(kind)
    model = recursive(**params, store_covariance=True).fit(e[:, None], u)
    assert_sound(model, excited=kind != "constants")
    never = recursive(**params).fit(e_never[:, None], u_never)
    horizon = round(np.max(never.memory_horizon_))
    again = model.coef_path_[BEFORE + PAUSE + 3 * horizon :]
    expected = never.coef_path_[BEFORE + 3 * horizon :]
    np.testing.assert_allclose(again, expected, rtol=0.01)
    assert never.n_held_ == 0
    assert (model.n_held_ > 0) == (kind != "missing")


@any_forgetting
def test_stuck_signals(params):
    """Values that stay and have nothing to do with each other."""
    (e, u), _ = paused("zeros")
    inside = slice(BEFORE, BEFORE + PAUSE)
    for values in ((1.0, 0.0), (-3.0, 1e6), (1e-200, 1e-200)):
        e[inside], u[inside] = values
        model = recursive(**params, store_covariance=True).fit(e[:, None], u)
        assert_sound(model)


# Channels


def two_channels(kind, n=20_000, seed=0):
    """Output of e, beside which stands a channel that says nothing new until the last 500 rows.

    Also returns the scale of that channel; its last rows drive the output by 2 of it.
    """
    rng = np.random.default_rng(seed)
    e, other = rng.standard_normal((2, n))
    x = {"dead": np.zeros(n), "constant": np.full(n, 3.0), "scaled duplicate": -1e5 * e}[kind]
    scale = max(1.0, np.abs(x).max() / 4)
    x[-500:] = scale * other[-500:]
    other[:-500] = 0.0
    u = respond(e, 0.01 * rng.standard_normal(n)) + lfilter([2.0], [1, *A], other)
    return np.column_stack([e, x]), u, scale


CHANNELS = ["dead", "constant", "scaled duplicate"]
TWO = {"na": 2, "nb": [2, 1], "nk": [3, 0], "init": "zeros"}


@pytest.mark.parametrize("kind", CHANNELS)
def test_a_channel_that_comes_alive_is_learnt(kind):
    """What was before weighs 3e-4 of what came since, 8 N0 after the change."""
    X, u, scale = two_channels(kind)
    model = RecursiveARX(**TWO, forgetting=0.95).fit(X, u)
    late = model.coef_path_[-500 + 160 :] * [1, 1, 1, 1, scale]
    np.testing.assert_allclose(late, np.tile([*A, *B, 2.0], (len(late), 1)), atol=0.02)


# Scales


# Protection is for what is not excited
