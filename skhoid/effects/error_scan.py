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

    def __call__(self, values: dict[str, float], seconds: float) -> float:
        """Sum of squares that the best multiple of the output simulated at values leaves.

        Parameters
        ----------
        values : dict of str to float
            Of the effect, and changes of the model.
        seconds : float
            Of the beginning of each run.

        Returns
        -------
        squares : float
        """

    def fitted(self, values: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Sum of squares on the whole runs, with the model fitted together with values.

        Parameters
        ----------
        values : dict of str to float
            Of the effect, and changes of the model to start from.

        Returns
        -------
        squares : float
        values : dict of str to float
            Of the effect, and changes of the model.
        """

    def refitted(
        self, output: np.ndarray, against: np.ndarray | None = None
    ) -> list[tuple[dict[str, float], np.ndarray]]:
        """The core alone fitted by least squares, without effects, to another output or input.

        Parameters
        ----------
        output : ndarray of shape (n_samples, n_runs)
            Such as the measured one with other signs.
        against : ndarray of shape (n_samples, n_runs) or None, default=None
            A force against the input, in its units, which does not wait for the dead time.

        Returns
        -------
        found : list of (dict of str to float, ndarray of shape (n_samples, n_runs))
            Changes of the model, and its free run; empty where the core is not linear in its
            parameters.
        """

    def earlier(self, seconds: float) -> dict[str, float]:
        """Changes of the model to ``ordinary`` that make it respond that much earlier.

        Parameters
        ----------
        seconds : float
            Such as the mean delay of a hold.

        Returns
        -------
        changes : dict of str to float
            To be merged with values of the effect.
        """

    def commands(self, seconds: float, ahead: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Command of the model at ``ordinary``, and its rate.

        Parameters
        ----------
        seconds : float
            Of the beginning of each run.
        ahead : float, default=0.0
            How much shorter the delay is, in seconds, where the core estimates one.

        Returns
        -------
        command, rate : ndarray of shape (n_samples, n_runs)
        """

    def left(self, columns: Sequence[np.ndarray], seconds: float) -> np.ndarray:
        """Sums of squares that the best sums of responses to commands leave, for many sums at once.

        Needs a core that responds as a second-order system: an operator.

        Parameters
        ----------
        columns : sequence of ndarray of shape (n_samples, n_runs, n_sums)
            Commands; each has a factor in its sum, and another on the rate of its response, which
            makes up for dynamics that are not ``ordinary``.
        seconds : float
            Of the beginning of each run.

        Returns
        -------
        squares : ndarray of shape (n_sums,)
        """

    def left_by_events(self, points: np.ndarray, seconds: float, of_error: bool) -> np.ndarray:
        """Sums of squares that commands held between events leave, for many at once.

        Needs a core that responds as a second-order system: an operator.

        Parameters
        ----------
        points : ndarray of shape (n_points, 4)
            Refractory time in seconds, threshold, ratio of the gains on rate and position, and
            factor on the command.
        seconds : float
            Of the beginning of each run.
        of_error : bool
            Whether events are changes of the error, not of the command.

        Returns
        -------
        found : ndarray of shape (n_points, 3)
            Squares, seconds by which an earlier response leaves these, and factor on the command.
        """
