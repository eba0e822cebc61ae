"""``Exploration``: a model of recorded runs that is changed step by step, and what each step gives.

Every number is the library's own: models are fitted by ``fit``, moved by ``with_parameters``,
predict by ``predict``, and are scored as ``VAFScorer`` does. Open it to change what a step does.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from sklearn.base import clone

from ... import DelayShift, EffectSearchCV
from ...effects import Effects, catalogue, title_of
from ...effects import effect as effect_of
from ...exceptions import did_you_mean
from ...model import simulated_model
from ...runs import of_person
from ..opening import make_estimator
from .linear import describe_linear, has_linear_part
from .models import (
    OUT,
    STRUCTURES,
    TRAIN,
    USES,
    History,
    Models,
    Position,
    Runs,
    name_structure,
    own_values,
)
from .people import MOST, PeopleFits
from .script import write_script
from .view import (
    Figures,
    Found,
    is_movable,
    judged_key,
    list_effects_found,
    list_others,
    make_curve,
)

MOST_NAMED = 3  # runs
ACTIONS = (
    "change",
    "any",
    "drag",
    "split",
    "search",
    "script",
    "report",
    "session",
    "linear",
    "people",
    "structure",
)
OPENS_ON = 15.0  # s of a run: over a whole one measured and simulated cannot be told apart
OF_STRUCTURE = {"operator": ("delay",), "arx": ("na", "nb", "nk")}
USED = {"train": "Fit", "hold": "Hold out", "out": "Leave out"}


class Exploration:
    """A model of recorded runs that is changed step by step.

    Parameters
    ----------
    estimator : OperatorRegressor, SimulatedARX or other model that simulates effects
        The model, unfitted; its effects are where it starts.
    X : DataFrame or array of shape (n_rows, n_columns)
        Channels, one row per sample.
    y : Series or array of shape (n_rows,)
        Measured output.
    search : EffectSearchCV or None, default=None
        A search that was fitted to X and y: its candidates are the cards.
    options : dict or None, default=None
        Parameters of searches from here; None takes those of the search.
    title : str or None, default=None
        Title; None names the model and the output.
    source : list of str or None, default=None
        Lines of Python that make X and y, for the script.
    memory : dict or None, default=None
        What :meth:`memory` returned: go on from there; ``search`` in it is what was found.
    fitted : sequence of estimators, default=()
        Models that are fitted to all runs already, known by their effects.
    preparation : list of str or None, default=None
        What was done to the recordings before, in words; the page shows it before the model.
    shift : DelayShift or None, default=None
        The fitted step that has shifted the input of X, which the linear part of models includes.

    Examples
    --------
    >>> from skhoid import OperatorRegressor, make_tracking_runs
    >>> from skhoid.effects import Bias
    >>> from skhoid.lab.explore import Exploration
    >>> X, y = make_tracking_runs("C1", 2, sampling_rate=50, effects=Bias(level=0.1))
    >>> by_hand = Exploration(OperatorRegressor(), X, y)
    >>> reply = by_hand.act("add", {"effect": "bias"})
    >>> [step["title"] for step in reply["state"]["stair"]]
    ['baseline', 'bias']
    """

    def __init__(
        self,
        estimator: Any,
        X: Any,
        y: Any,
        *,
        search: EffectSearchCV | None = None,
        options: Mapping[str, Any] | None = None,
        title: str | None = None,
        source: Sequence[str] | None = None,
        memory: Mapping[str, Any] | None = None,
        fitted: Sequence[Any] = (),
        preparation: Sequence[str] | None = None,
        shift: DelayShift | None = None,
    ):
        estimator = simulated_model(estimator, "Exploration")
        self.estimator = clone(estimator)
        self.options = dict(options or {})
        if search is not None and options is None:
            given = search.get_params(deep=False)
            self.options = {k: v for k, v in given.items() if k not in ("estimator", "n_jobs")}
        element = self.options.pop("controlled_element", None)
        if element is not None:
            self.estimator.set_params(controlled_element=element)
        domain, lost = self.options.get("domain"), self.options.get("lost_control", "leave_out")
        self.runs = Runs.of(self.estimator, X, y, domain, lost)
        self.domain = domain or ("human" if self._of_person() else "machine")
        uses = self._first_uses() if search is None else (TRAIN,) * self.runs.n
        first = Position(uses, Effects.of(self.estimator.effects), {}, "Begin")
        self.found = Found()
        if memory is not None and memory.get("search") is not None:
            self.found = Found.of_dict(memory["search"], self.runs)
        if search is not None:
            self.found = Found.of(search, first)
        self.models = Models(self.estimator, self.runs, fitted, self.found.controller)
        self.source = None if source is None else list(source)
        self.preparation, self.shift = preparation, shift
        self.title = title or f"{type(estimator).__name__} against measured {self.runs.output}"
        self.lock = threading.RLock()
        self.revision = 0
        self.own = {e.name: e for e in self._candidates()}
        self._progress: dict[str, Any] | None = None
        self.figures = Figures(self.models, self.domain)
        self.people: PeopleFits | None = None
        self.history = History(first)
        self.kept: dict[int, Position] = {}
        if memory is not None:
            self.history = History.of_dict(memory["history"])
            self.kept = {int(n): Position.of_dict(one) for n, one in memory["kept"].items()}
        self.models.fitted(self.here)

    @property
    def here(self) -> Position:
        return self.history.here

    @property
    def model(self) -> Any:
        """The present model, fitted."""
        return self.models.moved(self.here)

    def at_result(self) -> Exploration:
        """The same, gone on to the model that the search found; undo leads back to the start."""
        effects = self.with_found()
        if new := effects.names[len(self.here.effects) :]:
            words = f"Add {' and '.join(map(title_of, new))}"
            self._go(self.here.with_changes(words, effects=effects), {})
        return self

    def with_found(self) -> Effects:
        """The present effects, and behind them those of the best model of the search."""
        effects = self.here.effects
        for kind in [one.name for _, one in self.found.effects]:
            if kind in self.own and kind not in {e.name for _, e in effects}:
                effects = effects + self.found.effect(kind, self.own)
        return effects

    def act(self, name: str, args: Mapping[str, Any]) -> dict[str, Any]:
        """Do what was asked in the component; returns what it is told.

        ``args`` are by name; ``run`` is the number of the run that is shown. The reply has
        ``state``, ``simulated`` or what else the action gives. What is not possible is a
        ValueError, and nothing has changed then.
        """
        actions: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "trace": self._trace,
            "preview": self._preview,
            "model": self._model,
            "linear": self._linear,
            "keep": self._keep,
            "drop": self._drop,
            "people": lambda _: {"people": [] if self.people is None else [*self.people.rows]},
            "drag": self._drag,
            "state": self._shown,
            "script": lambda _: {"text": self.script()},
            "undo": lambda args: self._walk(-1, args),
            "redo": lambda args: self._walk(1, args),
        }
        if name not in actions and name not in STEPS:
            known = [*actions, *STEPS]
            raise ValueError(f"There is no action {name!r}.{did_you_mean(name, known)}")
        with self.lock:
            if name in STEPS:
                return self._go(STEPS[name](self, args), args)
            return actions[name](args)

    def script(self) -> str:
        """The present model as Python: a script that gives the same numbers."""
        with self.lock:
            vaf = self.figures.vaf(self.figures.prediction(self.here), self.here)
            figures = {"fitted": vaf["train"], "held out": vaf["hold"]}
            estimator = self.models.estimator_of(self.here)
            return write_script(estimator, self.runs, self.here, self.source, figures)

    def search_for(self) -> tuple[EffectSearchCV, Any, Any]:
        """A search, unfitted, from the present model, and the runs to fit it to."""
        with self.lock:
            model = self.models.estimator_of(replace(self.here, effects=with_moved(self)))
            return EffectSearchCV(model, **self.options), *self.runs.part(self.here.train)

    def take_search(self, search: EffectSearchCV, began: Position | None = None) -> None:
        """Take what a search found that began at a position: cards, verdict and noise ceiling.

        Where it found that a controller answers, operators are of that from here on.
        """
        with self.lock:
            known = self.models.controller
            found = Found.of(search, began or self.here)
            self.found = replace(found, controller=known or found.controller)
            if self.found.controller != known:
                self.models = Models(self.estimator, self.runs, (), self.found.controller)
                self.figures = Figures(self.models, self.domain)
            self._progress = None
            self._changed()

    def searched(self) -> EffectSearchCV | None:
        """The search of the runs that are fitted now, its models as all here; None without one."""
        with self.lock:
            found = self.found
            if found.result is None or not found.is_of(self.here):
                return None
            before, best = (
                replace(self.here, effects=effects) for effects in (found.before, found.effects)
            )
            search = EffectSearchCV(self.models.estimator_of(before), **self.options)
            models = self.models.fitted(before), self.models.fitted(best)
            return search.take_result(found.result, *models)

    def searching(self, progress: Mapping[str, Any] | None) -> None:
        """Say how far a search is: share (0 to 1) and words; None where none is running."""
        with self.lock:
            self._progress = None if progress is None else dict(progress)

    def begin_people(self) -> PeopleFits:
        """The present effects, to be fitted to each person alone; what was begun before ends."""
        with self.lock:
            if self.people is not None:
                self.people.stopped = True
            # Models of their own: a fit that takes long is not to hold up those of the page.
            models = Models(self.estimator, self.runs, (), self.models.controller)
            self.people = PeopleFits(models, replace(self.here, moved={}))
            return self.people

    def judge(self) -> None:
        """Find the noise ceiling and the findings of the present model."""
        with self.lock:
            here = self.here
        if self.figures.judge(here):
            with self.lock:
                self._changed()

    def memory(self) -> dict[str, Any]:
        """All that is needed to come back to this state, for JSON.

        What a search found is beside it, ``found.as_dict()``: it is large, and stays the same. To
        come back it is given as ``search``.
        """
        with self.lock:
            kept = {str(n): position.as_dict() for n, position in self.kept.items()}
            return {"history": self.history.as_dict(), "kept": kept}

    def view(self) -> dict[str, Any]:
        """What the component is told once."""
        runs = self.runs
        people = runs.people()
        person = {run: name for name, of_person in people for run in of_person}
        return {
            "title": self.title,
            "output": {"name": runs.output, "unit": runs.units.get(runs.output)},
            "dt": runs.layout.dt,
            "settling": float(getattr(self.estimator, "settling", 0.0)),
            "can": dict.fromkeys(ACTIONS, True)
            | dict.fromkeys(("linear", "structure"), has_linear_part(self.estimator))
            | {"people": len(people) > 1},
            "channels": [
                {"name": name, "role": role, "unit": runs.units.get(name)}
                for name, role in runs.roles.items()
            ],
            "people": [{"name": name, "runs": numbers} for name, numbers in people],
            "most_people": MOST,
            "runs": [
                {
                    "label": label,
                    "n": runs.rows(i).stop - runs.rows(i).start,
                    "person": person.get(i),
                }
                for i, label in enumerate(runs.labels)
            ],
            "shown": 0,
            "opens_on": OPENS_ON,
            "note": self._note(),
            "state": self.state(),
        }

    def state(self) -> dict[str, Any]:
        """What the component is told after each step."""
        with self.lock:
            return self.state_at(self.history)

    def state_at(self, history: History) -> dict[str, Any]:
        """The same at the present position of another history."""
        here = history.here
        model, fitted = self.models.moved(here), self.models.fitted(here)
        prediction = self.figures.prediction(here)
        cards, cards_of = self._cards(here)
        return {
            "revision": self.revision,
            "uses": list(here.uses),
            "effects": list_effects_found(model, here.moved, fitted, self.domain),
            "model": list_others(model, here.moved, fitted),
            "stair": self.figures.stair(here),
            **self.figures.ceiling(here, self.found),
            "vaf": self.figures.vaf(prediction, here),
            "run_vaf": self.runs.vaf_by_run(prediction),
            "settled": not here.moved,
            "impossible": self.figures.runs_away(prediction, here),
            "undo": history.undo,
            "redo": history.redo,
            "cards": [{**card, "ready": True} for card in cards],
            "cards_of": cards_of,
            **self._verdict(here),
            "to_add": self._to_add(here),
            "models": self._models(here),
            "findings": self.figures.findings(here, self.found),
            "limits": self.found.limits if self.found.is_of(here) else [],
            "search": self._progress,
            "people": self.people and self.people.told(here),
            "structure": self._structure(here),
            "preparation": self.preparation_of(here),
        }

    def _structure(self, here: Position) -> dict[str, Any] | None:
        """What the model is, as :func:`structured` takes it."""
        estimator = self.models.estimator_of(here)
        for core, kind in STRUCTURES.items():
            if isinstance(estimator, kind):
                own = {name: getattr(estimator, name) for name in OF_STRUCTURE[core]}
                return {"core": core, **own, "name": name_structure(estimator)}
        return None

    def preparation_of(self, here: Position) -> str | None:
        """What was done to the recordings, and the model, in one line."""
        if self.preparation is None:
            return None
        return " → ".join([*self.preparation, name_structure(self.models.estimator_of(here))])

    def _verdict(self, here: Position) -> dict[str, str]:
        """What the search said, and how the runs fitted now differ from its own."""
        found = self.found
        said = found.verdict_added if not self._lacking(here) else found.verdict
        if found.is_of(here):
            return {"verdict": said, "verdict_kind": found.kind}
        if found.structure != here.structure:
            of = name_structure(self.models.estimator_of(replace(here, structure=found.structure)))
            return {"verdict": f"The search was of the {of}. There: {said}", "verdict_kind": ""}
        more, fewer = ({*found.runs} - {*here.train}, {*here.train} - {*found.runs})
        differ = [f"on {self._list_runs(more)} too"] if more else []
        differ += [f"not on {self._list_runs(fewer)}"] if fewer else []
        other = f"The search was on other runs than are fitted now: {', and '.join(differ)}."
        return {"verdict": f"{other} There: {said}", "verdict_kind": ""}

    def _list_runs(self, runs: set[int]) -> str:
        names = ", ".join(self.runs.labels[run] for run in sorted(runs)[:MOST_NAMED])
        more = f" and {len(runs) - MOST_NAMED} more" if len(runs) > MOST_NAMED else ""
        return f"run{'s' if len(runs) > 1 else ''} {names}{more}"

    def _to_add(self, here: Position) -> list[str]:
        """What the verdict names and the model does not have yet."""
        return self._lacking(here) if self.found.is_of(here) else []

    def _lacking(self, here: Position) -> list[str]:
        present = {e.name for _, e in here.effects}
        return [kind for kind in self.found.named if kind in self.own and kind not in present]

    def _first_uses(self) -> tuple[str, ...]:
        """All runs are fitted, but of several people only those of the first: each is another."""
        people = self.runs.people()
        if len(people) < 2:
            return (TRAIN,) * self.runs.n
        return tuple(TRAIN if run in people[0][1] else OUT for run in range(self.runs.n))

    def _of_person(self) -> bool:
        roles = {*self.runs.roles.values()}
        return type(self.estimator).__name__ == "OperatorRegressor" or of_person(roles)

    def _candidates(self) -> list[Any]:
        effects = self.options.get("effects", "all")
        if isinstance(effects, str):
            return [effect_of(name) for name in catalogue().index]
        return [effect for _, effect in Effects.of(effects)]

    def effect(self, kind: str) -> Any:
        """The effect of an id, with the choices that a search made."""
        known = self.own.keys()
        if kind not in known:
            raise ValueError(f"No effect is called {kind!r}.{did_you_mean(kind, list(known))}")
        return self.found.effect(kind, self.own)

    def _cards(self, here: Position) -> tuple[list[dict[str, Any]], str]:
        fitting = [e for e in self.own.values() if self.domain in e.domains]
        return self.found.cards(here, fitting, self.domain)

    def _note(self) -> str | None:
        notes = []
        if self.runs.lost:
            seconds = sum(end - begin for _, begin, end in self.runs.lost)
            notes.append(f"{seconds:.3g} s in which control was lost are left out.")
        people = self.runs.people()
        if len(people) > 1:
            notes.append(
                f"Only the runs of {people[0][0]} are fitted at first: each person, in each "
                "condition, is another. "
                "Runs of several that are ticked together are fitted as those of one."
            )
        return " ".join(notes) or None

    def _of_run(self, prediction: np.ndarray, args: Mapping[str, Any]) -> np.ndarray:
        return prediction[self.runs.rows(self.run_of(args))]

    def run_of(self, args: Mapping[str, Any]) -> int:
        """The number of the run that arguments name."""
        run = args.get("run", 0)
        if not isinstance(run, int) or not 0 <= run < self.runs.n:
            raise ValueError(f"There is no run number {run!r}; there are {self.runs.n} runs.")
        return run

    def _trace(self, args: Mapping[str, Any]) -> dict[str, Any]:
        rows = self.runs.rows(self.run_of(args))
        prediction = self.figures.prediction(self.here)[rows]
        frame = self.runs.frame
        return {
            "t": self.runs.layout.time[rows],
            "measured": self.runs.measured[rows],
            "scored": self.runs.scored[rows],
            "simulated": prediction,
            "channels": {
                str(name): frame.iloc[rows, i].to_numpy(dtype=float)
                for i, name in enumerate(frame.columns)
            },
        }

    def _preview(self, args: Mapping[str, Any]) -> dict[str, Any]:
        here = self.here
        effects = here.effects + self.effect(str(args["effect"]))
        prediction = self.models.prediction(replace(here, effects=effects))
        return {
            "simulated": self._of_run(prediction, args),
            "vaf": self.runs.vaf(prediction, here.train),
        }

    # Models side by side.

    def _keep(self, args: Mapping[str, Any]) -> dict[str, Any]:
        same = [n for n, one in self.kept.items() if judged_key(one) == judged_key(self.here)]
        if same:
            raise ValueError(f"This model is kept already, as model {same[0]}.")
        self.kept[max(self.kept, default=0) + 1] = self.here
        return self._shown(args, changed=True)

    def _drop(self, args: Mapping[str, Any]) -> dict[str, Any]:
        del self.kept[self.number_of(args)]
        return self._shown(args, changed=True)

    def _model(self, args: Mapping[str, Any]) -> dict[str, Any]:
        one = self.kept[self.number_of(args)]
        return {"simulated": self._of_run(self.figures.prediction(one), args)}

    def _linear(self, args: Mapping[str, Any]) -> dict[str, Any]:
        """The linear part of the present model, or as it is dragged, and of kept ones."""
        to = moved(self, args) if "name" in args else self.here
        kept = {n: self.kept[self.number_of({"model": n})] for n in args.get("models", [])}
        return self.linear_of({0: to, **kept}, self.figures.measured(self.here))

    def linear_of(self, positions: Mapping[int, Position], measured: Any) -> dict[str, Any]:
        """What the component draws of the linear parts of models."""
        models = {n: self.models.moved(one) for n, one in positions.items()}
        roles = self.runs.roles
        answered = "e" if "e" in roles.values() else "f_t"
        same = roles.get(str(models[0].inputs_[0])) == answered
        return describe_linear(models, measured if same else None, self.domain, self.shift)

    def number_of(self, args: Mapping[str, Any]) -> int:
        """The number of the kept model that arguments name."""
        number = args["model"]
        if number not in self.kept:
            raise ValueError(f"There is no model {number!r:.20}; kept are {[*self.kept]}.")
        return int(number)

    def _models(self, here: Position) -> list[dict[str, Any]]:
        """The present model and those that were kept, all judged on the present runs."""
        return [self._told(number, one, here) for number, one in [(0, here), *self.kept.items()]]

    def _told(self, number: int, one: Position, here: Position) -> dict[str, Any]:
        prediction = self.figures.prediction(one)
        table = self.models.moved(one).parameter_table_
        title = " and ".join(map(title_of, one.effects.names)) or "baseline"
        if any(position.structure for position in (here, *self.kept.values())):
            title = f"{name_structure(self.models.estimator_of(one))}, {title}"
        return {
            "id": number,
            "title": title + (", moved by hand" if one.moved else ""),
            "vaf": self.figures.vaf(prediction, here),
            "other_runs": one.train != here.train,
            "parameters": [
                {"name": p.name, "value": p.value, "unit": p.unit, "free": p.free}
                for p in table.values()
            ],
        }

    def _drag(self, args: Mapping[str, Any]) -> dict[str, Any]:
        to, name = moved(self, args), str(args["name"])
        model = self.models.moved(to)  # refuses what is not possible
        prediction = self.figures.prediction(to)
        return {
            "simulated": self._of_run(prediction, args),
            "vaf": self.figures.vaf(prediction, to),
            "run_vaf": self.runs.vaf_by_run(prediction),
            "stair": self.figures.stair(to),
            "impossible": self.figures.runs_away(prediction, to),
            "curve": make_curve(model, name.split("__")[0]) if "__" in name else None,
            "settled": False,
        }

    def _go(self, position: Position, args: Mapping[str, Any]) -> dict[str, Any]:
        """Take a step, if its model can be fitted."""
        self.figures.prediction(position)
        self.history.go(position)
        return self._shown(args, changed=True)

    def _shown(self, args: Mapping[str, Any], *, changed: bool = False) -> dict[str, Any]:
        if changed:
            self._changed()
        return {
            "state": self.state(),
            "simulated": self._of_run(self.figures.prediction(self.here), args),
        }

    def _changed(self) -> None:
        self.revision += 1

    def _walk(self, by: int, args: Mapping[str, Any]) -> dict[str, Any]:
        self.history.step(by)
        return self._shown(args, changed=True)


# What each step leads to: the next position, or why there is none.


def recalled(of: Exploration, args: Mapping[str, Any]) -> Position:
    """A model that was kept."""
    number = of.number_of(args)
    one = of.kept[number]
    return one.with_changes(f"Go to model {number}")


def added(of: Exploration, args: Mapping[str, Any]) -> Position:
    """One more effect, by its id, or several."""
    here, asked = of.here, args["effect"]
    effects, titles = here.effects, []
    for kind in asked if isinstance(asked, list) else [asked]:
        effect = of.effect(str(kind))
        titles.append(title_of(effect.name))
        if effect.name in {e.name for _, e in effects}:
            raise ValueError(f"The model has the effect {titles[-1]} already.")
        effects = effects + effect
    return here.with_changes(f"Add {' and '.join(titles)}", effects=effects)


def removed(of: Exploration, args: Mapping[str, Any]) -> Position:
    """One effect fewer, by its name in the model."""
    name, here = str(args["effect"]), of.here
    if name not in here.effects.names:
        raise ValueError(f"The model has no effect {name!r}.")
    left = Effects([(n, e) for n, e in here.effects if n != name])
    moved = own_values(here.moved, left)
    return here.with_changes(f"Remove {title_of(name)}", effects=left, moved=moved)


def moved(of: Exploration, args: Mapping[str, Any]) -> Position:
    """A parameter at another value, all others as they are."""
    name, value, here = str(args["name"]), args["value"], of.here
    if not is_movable(of.models.fitted(here), name):
        raise ValueError(f"{name!r} is no parameter of this model that can be moved.")
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ValueError(f"{name} must be a number; got {value!r}.")
    check_possible(of, name, float(value))
    values = {**here.moved, name: float(value)}
    return here.with_changes(f"Move {_words(name)}", moved=values)


def check_possible(of: Exploration, name: str, value: float) -> None:
    """Refuse what is beyond the bounds of a parameter, in the words that the user sees."""
    model = of.models.fitted(of.here)
    one = model.parameter_table_.get(name)
    if one is None or one.min <= value <= one.max:
        return
    unit = one.unit.replace("-", "").strip()
    raise ValueError(
        f"{_words(name)} = {value:.6g} {unit}".rstrip()
        + " is beyond what is possible, "
        f"or too small to matter: it may be {one.min:.4g} to {one.max:.4g} {unit}".rstrip()
        + "."
    )


def refitted(of: Exploration, args: Mapping[str, Any]) -> Position:
    """All parameters fitted but those of effects that were moved, which are kept as they are."""
    if not of.here.moved:
        raise ValueError("Nothing was moved: all parameters are those of the fit.")
    return of.here.with_changes("Refit the others", effects=with_moved(of), moved={})


def freed(of: Exploration, args: Mapping[str, Any]) -> Position:
    """A parameter that was kept, estimated again."""
    full, here = str(args["name"]), of.here
    name, _, key = full.partition("__")
    known = dict(here.effects.steps)
    if name not in known or key not in known[name].fixed:
        raise ValueError(f"{full!r} is not kept at a number.")
    steps = [(n, e.with_choices(**{key: None}) if n == name else e) for n, e in here.effects]
    return here.with_changes(f"Estimate {_words(full)}", effects=Effects(steps))


def used(of: Exploration, args: Mapping[str, Any]) -> Position:
    """Runs for another use."""
    use, chosen = str(args["use"]), [of.run_of({"run": run}) for run in args["runs"]]
    if use not in USES:
        raise ValueError(f"A run is used for one of {', '.join(USES)}; got {use!r}.")
    uses = list(of.here.uses)
    for run in chosen:
        uses[run] = use
    if TRAIN not in uses:
        raise ValueError("At least one run must be left to fit: tick another one first.")
    names = of.runs.labels[chosen[0]] if len(chosen) == 1 else f"{len(chosen)} runs"
    return of.here.with_changes(f"{USED[use]} {names}", uses=tuple(uses))


def structured(of: Exploration, args: Mapping[str, Any]) -> Position:
    """The same effects with another structure, whose delay nk is found where nothing is said."""
    here, core = of.here, args["core"]
    if core not in STRUCTURES:
        raise ValueError(f"A structure is one of {', '.join(STRUCTURES)}; got {core!r:.20}.")
    if core == "operator" and of.shift is not None:
        raise ValueError(
            f"The input is shifted by {of.shift.delay:g} s already, and the operator has a delay "
            "of its own: go back to the columns, and empty the delay shift."
        )
    unsaid = dict.fromkeys(("na", "nb", "nk", "delay"))
    said = SimpleNamespace(**{**unsaid, **args}, shift=of.shift)
    about = {name: getattr(of.estimator, name) for name in ("inputs", "roles", "dt", "run")}
    made = make_estimator(said, *of.runs.part(here.train), **about)
    own = {"core": core} | {name: getattr(made, name) for name in OF_STRUCTURE[core]}
    words = name_structure(made)
    if words == name_structure(of.models.estimator_of(here)):
        raise ValueError(f"The model is this already: {words}.")
    structure = {} if words == name_structure(of.estimator) else own
    return here.with_changes(f"Fit {words}", structure=structure, moved={})


STEPS: dict[str, Callable[[Exploration, Mapping[str, Any]], Position]] = {
    "add": added,
    "remove": removed,
    "release": moved,
    "refit": refitted,
    "free": freed,
    "use": used,
    "recall": recalled,
    "structure": structured,
}


def with_moved(of: Exploration) -> Effects:
    """The present effects with what was moved as given numbers, and their choices made."""
    here = of.here
    if not here.moved:
        return here.effects
    kept, steps = dict(here.effects.steps), []
    for name, effect in of.models.fitted(here).simulation_.effects:
        start = f"{name}__"
        own = {k[len(start) :]: v for k, v in here.moved.items() if k.startswith(start)}
        steps.append((name, effect.with_choices(**own) if own else kept[name]))
    return Effects(steps)


def _words(name: str) -> str:
    """A parameter of an effect for people: ``dead_zone__width`` as "dead zone: width"."""
    effect, _, key = name.partition("__")
    return f"{title_of(effect)}: {key.replace('_', ' ')}" if key else name
