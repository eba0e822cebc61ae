"""``Progress``: tells scikit-learn's callbacks how far a search for effects has got."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class Progress:
    """Steps of a search, and what is done in each, as subtasks of its ``fit``.

    Without a context it says nothing, as in other processes.

    Parameters
    ----------
    estimator : EffectSearchCV or None, default=None
        The search.
    context : CallbackContext or None, default=None
        That of its ``fit``.
    """

    def __init__(self, estimator: Any = None, context: Any = None):
        self._estimator, self._context = estimator, context
        self._task: Any = None
        self._left = 0

    def __getstate__(self) -> dict[str, Any]:
        return vars(Progress())

    @contextmanager
    def step(self, n: int) -> Iterator[Callable[[int], None]]:
        """A step of n pieces of work; inside another it is part of that."""
        if self._context is None or self._task is not None:
            yield self.done
            return
        task = self._context.subcontext(task_name="effects tried", max_subtasks=n)
        self._task, self._left = task, n
        task.call_on_fit_task_begin(estimator=self._estimator)
        try:
            yield self.done
        finally:
            self._task = None
            task.call_on_fit_task_end(estimator=self._estimator)

    def done(self, n: int) -> None:
        """Say that n more pieces of work are done."""
        for _ in range(min(n, self._left) if self._task is not None else 0):
            self._left -= 1
            piece = self._task.subcontext()
            piece.call_on_fit_task_begin(estimator=self._estimator)
            piece.call_on_fit_task_end(estimator=self._estimator)
