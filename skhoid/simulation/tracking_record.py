"""``TrackingRecord``: the signals of simulated runs, their scores and remnant intensity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class TrackingRecord:
    """Signals of simulated runs.

    Parameters
    ----------
    time : ndarray of shape (n_samples,)
        Time in s; 0 is the beginning of the measurement window.
    e, u, x, n : ndarray of shape (n_runs, n_samples)
        Error, control output, output of the controlled element, and remnant (in u).
    f_t, f_d : ndarray of shape (1 or n_runs, n_samples)
        Target, and disturbance at the input of the controlled element.

    Examples
    --------
    >>> from skhoid import CompensatoryTask
    >>> record = CompensatoryTask.of_condition("C1").simulate()
    >>> record.score().round(4)
    array([0.1778])
    """

    time: np.ndarray
    e: np.ndarray
    u: np.ndarray
    x: np.ndarray
    n: np.ndarray
    f_t: np.ndarray
    f_d: np.ndarray

    @property
    def u_without_remnant(self) -> np.ndarray:
        """The operator's response u - n, of shape (n_runs, n_samples)."""
        return self.u - self.n

    def intensity(self) -> np.ndarray:
        """Remnant intensity P_n = var(n) / var(u) of each run (Eq. 5.11), in the window.

        Returns
        -------
        P_n : ndarray of shape (n_runs,)
        """
        window = self.time >= 0
        return self.n[:, window].var(axis=1) / self.u[:, window].var(axis=1)

    def score(self) -> np.ndarray:
        """Performance score var(e) / var(f_t) of each run, in the window.

        Returns
        -------
        score : ndarray of shape (n_runs,)
        """
        window = self.time >= 0
        return self.e[:, window].var(axis=1) / self.f_t[:, window].var(axis=1)
