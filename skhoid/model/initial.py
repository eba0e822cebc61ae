"""How free runs begin: from rest, as if the inputs had always been as at first, or as y shows.

What precedes a record adds to the answer of a linear core the free response of its state, a sum of
as many decaying signals as the core has states. ``Start`` adds it after all stages: a given one
where only the inputs are known, the one that fits best in each run where the output is. These
initial states are nuisance parameters that no table shows: solved for in every simulation, they
move along with the parameters (variable projection). Behind a nonlinear effect on the output they
are solved for by Gauss-Newton iteration, as they are where something acts inside the recursion,
such as an outflow by the root of the level, which acts on the initial state too; springs are taken
as linear in them.

A person forgets within seconds how a run began, and an integral never: its free response, a
constant or one that decays slowly, is a state like the others, and the only one that is estimated
of a person whose first seconds do not count (``LASTING``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from ..arx.base import pays
from ..effects.record import Record

LASTING = "lasting"  # all is at rest but what lasts, which is estimated
FORGOTTEN = 2.0  # s of settling, after which an operator has forgotten how a run began
ROUNDING = 1e-13  # of the largest square, by which others may be off
WEAK = 1e-6  # share of its squares in the known rows from which a state is estimated in full
GONE = 1e-9  # of a free response
MARGIN = 1.3  # times that long, for poles that lie together
N_NEWTON = 3  # iterations behind a nonlinear effect
WORTHWHILE = 1e-4  # share of the squares, below which these end
DIFFERENCE = 1e-3  # of the output's standard deviation, of the derivatives there


def begin_where_it_pays(record: Record, free: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """Outputs with columns from ``fitted`` where that pays, from ``free`` elsewhere.

    Each run is judged alone: its prediction must not depend on the other runs.
    """
    assert record.y is not None
    with np.errstate(over="ignore", invalid="ignore"):
        left = zip(_sum_squares(record, free), _sum_squares(record, fitted), strict=True)
        pairs = [(float(rest), float(other)) for rest, other in left]
    chosen = free.copy()
    for j, (rest, other) in enumerate(pairs):
        if pays(rest, other, record.y[record.known[:, j], j]):
            chosen[:, j] = fitted[:, j]
    return chosen


def find_error(record: Record, output: np.ndarray) -> float:
    """Sum of squares over what is known; infinite where the output is not finite."""
    assert record.y is not None
    with np.errstate(over="ignore", invalid="ignore"):
        error = (record.y - output)[record.known]
        total = float(error @ error)
    return total if np.isfinite(total) else np.inf


def find_horizon(denominator: np.ndarray, n: int) -> int:
    """Rows, of ``n``, in which the free response of 1 / A matters."""
    radius = float(np.abs(np.roots(denominator)).max(initial=0.0))
    if not radius > GONE:
        return min(n, denominator.size)
    if radius >= 1.0:
        return n
    return int(min(n, MARGIN * np.log(GONE) / np.log(radius) + 2 * denominator.size))


def make_free_responses(denominator: np.ndarray, n: int) -> np.ndarray:
    """Orthonormal free responses (n, n_states) of a system 1 / A; those of unstable ones end."""
    states = min(denominator.size - 1, n)
    if states == 0:
        return np.zeros((n, 0))
    impulse = np.zeros(n)
    impulse[0] = 1.0
    with np.errstate(over="ignore", invalid="ignore"):
        response = lfilter([1.0], denominator, impulse)
    large = np.flatnonzero(~(np.abs(response) < 1 / GONE))
    if large.size:
        response[large[0] :] = 0.0
    late = np.zeros((n, states))
    for k in range(states):
        late[k:, k] = response[: n - k]
    return np.linalg.qr(late)[0]


def fit_states(responses: np.ndarray, residual: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Amounts (n_states, n_runs) of free responses that fit a residual (n, n_runs) best.

    Those that the known rows hardly show stay small.
    """
    n, states = responses.shape
    products = (responses[:, :, None] * responses[:, None, :]).reshape(n, states * states)
    gram = (known.T.astype(float) @ products).reshape(-1, states, states)
    right = np.where(known, residual, 0.0).T @ responses
    ridge = WEAK * np.eye(states)
    return np.linalg.solve(gram + ridge, right[:, :, None])[:, :, 0].T


@np.errstate(over="ignore", invalid="ignore")  # a trial may run away
def fit_start(
    record: Record,
    core_output: np.ndarray,
    responses: np.ndarray,
    behind: Callable[[np.ndarray], np.ndarray],
    additive: bool,
) -> np.ndarray:
    """Output from the initial states that fit the measured one best, in rows of ``responses``.

    ``behind`` are the stages after the core, which only add to the output where ``additive``.
    """
    assert record.y is not None
    n, states = responses.shape
    output = behind(core_output)
    if not states or not np.isfinite(output).all():
        return output
    if additive:
        amounts = fit_states(responses, record.y[:n] - output[:n], record.known[:n])
        output = output.copy()
        output[:n] += responses @ amounts
        return output

    def begun(amounts: np.ndarray) -> np.ndarray:
        answer = core_output.copy()
        answer[:n] += responses @ amounts
        return behind(answer)

    start = np.zeros((states, record.n_runs))
    hidden = record.y[record.known].min(initial=0.0) >= 0.0  # by a sensor, as the sign may be
    for sign in (1.0, -1.0) if hidden else (1.0,):
        wanted = sign * record.y[:n] - core_output[:n]
        guess = fit_states(responses, wanted, record.known[:n])
        start, output = _keep_better(record, begun, guess, start, output)
    return _iterate(record, begun, start, output)


def fit_pulses(
    record: Record,
    begun: Callable[[np.ndarray], np.ndarray],
    held: np.ndarray,
    states: int,
) -> np.ndarray:
    """Output of a recursion whose beginning fits the measured one best.

    What acts inside it, such as an outflow by the root of the level, acts on its state too.
    ``begun`` is the output of what is added to the recursion's first samples; ``held`` is added
    where the inputs were always as at first, of which the first ``states`` rows are estimated.
    """
    assert record.y is not None
    states = min(states, len(held))
    output = begun(held)
    if not states or not np.isfinite(output).all():
        return output

    def of(amounts: np.ndarray) -> np.ndarray:
        pulses = held.copy()
        pulses[:states] += amounts
        return begun(pulses)

    start = np.zeros((states, record.n_runs))
    guess = start.copy()
    guess[0] = record.y[0] - output[0]  # measured, whether it counts or not
    return _iterate(record, of, *_keep_better(record, of, guess, start, output))


def _keep_better(
    record: Record,
    begun: Callable[[np.ndarray], np.ndarray],
    guess: np.ndarray,
    start: np.ndarray,
    output: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Amounts and output of a guess in the runs where it fits better, unchanged in the others."""
    trial = begun(guess)
    better = _sum_squares(record, trial) < _sum_squares(record, output)
    return np.where(better, guess, start), np.where(better, trial, output)


def _iterate(
    record: Record,
    begun: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    output: np.ndarray,
) -> np.ndarray:
    """The output of the amounts (n_states, n_runs) that fit best near some, where it is better."""
    assert record.y is not None
    states, step = len(start), DIFFERENCE * record.sd("u")
    for _ in range(N_NEWTON):
        residual = np.where(record.known, record.y - output, 0.0)
        slopes = np.stack(
            [
                np.where(record.known, (begun(start + step * one[:, None]) - output) / step, 0.0)
                for one in np.eye(states)
            ]
        )
        gram = np.einsum("inj,knj->jik", slopes, slopes)
        if not np.isfinite(gram).all():  # it runs away
            break
        ridge = np.maximum(WEAK, ROUNDING * gram.max(axis=(1, 2)))
        gram += ridge[:, None, None] * np.eye(states)
        right = np.einsum("inj,nj->ji", slopes, residual)
        change = np.linalg.solve(gram, right[:, :, None])[:, :, 0].T
        trial = begun(start + change)
        before, after = _sum_squares(record, output), _sum_squares(record, trial)
        better = after < before
        start = start + np.where(better, change, 0.0)
        output = np.where(better, trial, output)
        if not (before - after > WORTHWHILE * before).any():
            break
    return output


def _sum_squares(record: Record, output: np.ndarray) -> np.ndarray:
    assert record.y is not None
    return np.asarray((np.where(record.known, record.y - output, 0.0) ** 2).sum(axis=0))
