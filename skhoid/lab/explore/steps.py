"""What each step of an exploration leads to: the next position, or why there is none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ...effects.composition import Effects
from ...effects.registry import title_of
from .models import own_values
from .position import TRAIN, USES, Position

if TYPE_CHECKING:
    from .exploration import Exploration

USED = {"train": "Fit", "hold": "Hold out", "out": "Leave out"}


def added(of: Exploration, args: Mapping[str, Any]) -> Position:
    """One more effect, by its id."""
    here, effect = of.here, of.effect(str(args["effect"]))
    if effect.name in {e.name for _, e in here.effects}:
        raise ValueError(f"The model has the effect {title_of(effect.name)} already.")
    return here.with_changes(f"Add {title_of(effect.name)}", effects=here.effects + effect)


def removed(of: Exploration, args: Mapping[str, Any]) -> Position:
    """One effect fewer, by its name in the model."""
    name, here = str(args["effect"]), of.here
    if name not in here.effects.names:
        raise ValueError(f"The model has no effect {name!r}.")
    left = Effects([(n, e) for n, e in here.effects if n != name])
    moved = own_values(here.moved, left)
    return here.with_changes(f"Remove {title_of(name)}", effects=left, moved=moved)


def moved(of: Exploration, args: Mapping[str, Any]) -> Position:
    """A parameter of an effect at another value, all others as they are."""
    name, value, here = str(args["name"]), args["value"], of.here
    if name.partition("__")[0] not in here.effects.names:
        raise ValueError(f"{name!r} is no parameter of an effect of this model.")
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ValueError(f"{name} must be a number; got {value!r}.")
    check_possible(of, name, float(value))
    values = {**here.moved, name: float(value)}
    return here.with_changes(f"Move {_words(name)}", moved=values)


def check_possible(of: Exploration, name: str, value: float) -> None:
    """Refuse what is beyond the bounds of a parameter, in the words that the user sees."""
    model = of.models.fitted(of.here.effects, of.here.train)
    one = model.parameter_table_.get(name)
    if one is None or one.min <= value <= one.max:
        return
    unit = one.unit.replace("-", "").strip()
    raise ValueError(
        f"{_words(name)} = {value:.6g} {unit}".rstrip()
        + " is beyond what is physically possible, "
        f"or too small to matter: it may be {one.min:.4g} to {one.max:.4g} {unit}".rstrip()
        + "."
    )


def refitted(of: Exploration, args: Mapping[str, Any]) -> Position:
    """All parameters fitted but those that were moved, which are kept as they are."""
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


STEPS: dict[str, Callable[[Exploration, Mapping[str, Any]], Position]] = {
    "add": added,
    "remove": removed,
    "release": moved,
    "refit": refitted,
    "free": freed,
    "use": used,
}


def with_moved(of: Exploration) -> Effects:
    """The present effects with what was moved as given numbers, and their choices made."""
    here = of.here
    if not here.moved:
        return here.effects
    kept, steps = dict(here.effects.steps), []
    for name, effect in of.models.fitted(here.effects, here.train).simulation_.effects:
        start = f"{name}__"
        own = {k[len(start) :]: v for k, v in here.moved.items() if k.startswith(start)}
        steps.append((name, effect.with_choices(**own) if own else kept[name]))
    return Effects(steps)


def _words(name: str) -> str:
    """A parameter of an effect for people: ``dead_zone__width`` as "dead zone: width"."""
    effect, _, key = name.partition("__")
    return f"{title_of(effect)}: {key.replace('_', ' ')}"
