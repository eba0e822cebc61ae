"""What an effect may ask of the model it is added to: read it to write ``scanned``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np


class ErrorScan(Protocol):
    """What a fitted model leaves unexplained, for values of an effect that is tried in it.

    Models and searches pass one to ``Effect.scanned`` and ``Effect.scanned_beside``, which look for
    values to start estimation from. Calling it, ``error_of(values, seconds)``, suffices for most
    effects and any core; the rest is faster, or follows the model's own parameters.

    ``values`` are those of the effect's parameters by name, and changes of parameters of the model
    by ``"+"`` and their name, as ``{"width": 0.3, "+tau_e": -0.1}``: changes of what the model does
    not have are ignored. ``seconds`` are those of the beginning of each run, ``inf`` for all.

    See Also
    --------
    skhoid.effects.Effect : The base of all effects.

    Examples
    --------
    The best of many values of a time, where the default tries a few:

    >>> from skhoid.effects import Effect
    >>> class Late(Effect):
    ...     def scanned(self, error_of, record):
    ...         tried = [{"time": 0.01 * record.duration * i} for i in range(100)]
    ...         return [min(tried, key=lambda values: error_of(values, record.duration))]
    """

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the model without the effect: of its core, and of effects before it."""

    @property
    def ordinary(self) -> dict[str, float]:
        """The same where the dynamics of the core are ordinary, and gains and delay fit them.

        What is missing bends estimated dynamics. ``parameters`` if a core has no ordinary ones.
        """

    @property
    def residual(self) -> np.ndarray:
        """Measured less simulated output without the effect, of shape (n_samples, n_runs)."""

    @property
    def explores(self) -> bool:
        """Whether fewer rows count than in the fit; what depends on single rows differs then."""

    @property
    def again(self) -> bool:
        """Whether it was scanned beside a smaller model before, and need not be as closely."""

    @property
    def asked(self) -> float:
        """Share of the squares without the effect that it has to save; other effects save more."""

    def __call__(self, values: dict[str, float], seconds: float) -> float:
        """Sum of squares that the best multiple of the output simulated at values leaves."""

    def fitted(self, values: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Sum of squares on the whole runs, and the values, with the model fitted beside them."""

    def refitted(
        self, output: np.ndarray, against: np.ndarray | None = None
    ) -> list[tuple[dict[str, float], np.ndarray]]:
        """The core alone fitted by least squares to another output (n_samples, n_runs).

        ``against`` is a force against the input, in its units, which does not wait for the dead
        time. Gives changes of the model and its free run; nothing where the core is not linear in
        its parameters.
        """

    def earlier(self, seconds: float) -> dict[str, float]:
        """Changes of the model to ``ordinary`` that make it respond that much earlier."""

    def commands(self, seconds: float, ahead: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Command of the model at ``ordinary``, and its rate, both (n_samples, n_runs).

        ``ahead`` is how much shorter the delay is, in seconds, where the core estimates one.
        """

    def left(self, columns: Sequence[np.ndarray], seconds: float) -> np.ndarray:
        """What the best sums of responses to commands leave of the squares, for many sums at once.

        Each of the ``columns``, commands of shape (n_samples, n_runs, n_sums), has a factor in its
        sum, and another on the rate of its response, which makes up for dynamics that are not
        ``ordinary``. Needs a core that responds as a second-order system: an operator.
        """

    def left_by_events(
        self,
        points: np.ndarray,
        seconds: float,
        of_error: bool,
        *,
        ahead: float = 0.0,
        window: float = np.inf,
    ) -> np.ndarray:
        """What commands held between events leave of the squares, for many at once.

        A point has refractory time (s), threshold, ratio of the gains on rate and position, and
        factor on the command; with ``of_error`` events are changes of the error. ``ahead`` is how
        much shorter the delay is, in seconds, where the core estimates one. Runs may be cut into
        windows (s), each of which begins as suits it best: events off in one do not move those of
        others. Gives, for each,
        squares, seconds by which an earlier response leaves these, and factor on the command.
        Needs a core that responds as a second-order system: an operator.
        """

    def left_without(self, seconds: float, window: float = np.inf) -> float:
        """Squares that the model without the effect leaves on the rows of ``left_by_events``."""
