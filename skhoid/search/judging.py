"""What counts: evidence in nats, the least that every judge grants, and the order of candidates.

The evidence of a judge is the difference of the log likelihoods that it sees, less log(n) / 2 for
each parameter more: half of ΔBIC, to first order the log of the odds by which the data change from
the parent to the model. Judges are in :mod:`skhoid.search.judges`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..effects.base import Effect
from ..effects.registry import title_of
from ..model.extend import Explored
from ..model.model import AT_BOUND, Model
from .statuses import Against, Reason

# Nats of every judge, for an effect to be added: some forty effects are tried in a few forms each
# (log 100 = 4.6), and model errors, which no likelihood knows, reach 8 nats in runs with nothing
# hidden (both blind trials, development seeds).
THRESHOLD = 12.5
LEAST_GAIN = 0.2  # points of VAF on held-out rows: what sensors and simulation are off by
# Points by which simulations with other steps and filters differ, at most: a given delay that is a
# little off makes up for as much, and so does a free shape.
FLOOR = 0.6
# Times the nats after an iteration, and nats more, that a fit to the end has at most: the most seen
# was 18 nats more (seed 26); with these, names were as by ``exhaustive`` in 54 of 54 searches of
# benchmarks/exhaustive.py.
MORE, MORE_IF_IT_JUMPS, SLACK = 1.5, 2.5, 15.0
SURE = 3.0  # standard errors, by which an effect's size is off that at which it does nothing
CLAIM = "wrong_delay"  # the effect by which a given delay is freed
AT_ZERO = 1e-9  # rounding of a bound
FREE_RUN, LIKELIHOOD, INSTRUMENTS = "free run", "likelihood", "instruments"
TRACE = "trace"
HELD_OUT, NUMBERS = "held-out rows", "parameters"


@dataclass
class Candidate:
    """An effect tried in addition to a parent, under a name there, and the result.

    ``evidence`` are nats by judge, NaN of one that cannot know the effect. ``gain`` are points of
    VAF on held-out rows, with parameters one step from those of all rows, or refitted once
    ``refit`` is true. It is compared with ``before``, at the likelihood and at the least error.
    Where it is only ``begun``, from what was ``explored``, its numbers are an iteration off.
    """

    name: str
    effect: Effect
    model: Model | None = None
    before: tuple[Model, Model] | None = None
    untried: Against | None = None  # why it is not fitted, such as what the data do not have
    evidence: dict[str, float] = field(default_factory=dict)
    n_parameters: float = 0
    vaf: float = -np.inf
    gain: float = -np.inf
    p_value: float = 1.0
    prediction: np.ndarray | None = None
    confused_with: list[str] = field(default_factory=list)
    trace: str = ""
    least_gain: float = LEAST_GAIN
    refused: Against | None = None
    refit: bool = False
    probability: float = np.nan
    explored: Explored | None = None
    begun: bool = False

    @property
    def hoped(self) -> float:
        """Nats that it may have at most, if it is only begun: else there is nothing to hope for."""
        if not self.begun:
            return -np.inf
        most = MORE if self.effect.smooth else MORE_IF_IT_JUMPS
        nats = self.evidence.get(FREE_RUN, -np.inf)
        return max(nats, most * nats) + SLACK

    @property
    def known(self) -> dict[str, float]:
        """Nats of the judges that can know it.

        Neither instruments nor likelihood are misled by the remnant, but the noise model of a
        likelihood takes up a part of what is linear: what instruments grant counts by the more of
        both. Of what jumps they see too little, and may only refuse. Rows that are held out, and
        the effect's numbers, have no nats to give, and may take all.
        """
        known = {judge: nats for judge, nats in self.evidence.items() if not np.isnan(nats)}
        if known.get(INSTRUMENTS, -np.inf) > THRESHOLD:
            judges = {INSTRUMENTS, LIKELIHOOD} if self.effect.smooth else {FREE_RUN, LIKELIHOOD}
            granted = {name: known[name] for name in judges & known.keys()}
            choose = max if self.effect.smooth else min
            judge = choose(granted, key=lambda name: granted[name])
            known = {judge: granted[judge]}
        if self.refused is not None:
            known[NUMBERS] = 0.0
        if self.gain < (-self.least_gain if self.trace else self.least_gain):
            known[HELD_OUT] = 0.0
        return known

    @property
    def least(self) -> float:
        """The least evidence of the judges asked that can know it; -inf where none can."""
        return min(self.known.values(), default=-np.inf)

    @property
    def judge(self) -> str:
        """Which judge grants the least."""
        return min(self.known, key=lambda name: self.known[name], default="")

    @property
    def passes(self) -> bool:
        """Whether it counts, as far as judges were asked."""
        return self.least > THRESHOLD

    @property
    def delta_bic(self) -> float:
        """ΔBIC of the free run."""
        return 2 * self.evidence.get(FREE_RUN, -np.inf)


def find_likeliest_alternatives(candidates: list[Candidate]) -> list[Candidate]:
    """For each effect the alternative that explains most, in the order of the effects."""
    found: dict[str, Candidate] = {}
    for one in candidates:
        if one.name not in found or rank(one) < rank(found[one.name]):
            found[one.name] = one
    return list(found.values())


def rank(candidate: Candidate) -> tuple[bool, float, float]:
    """Key of the order: fitted ones by the least evidence, then by the free run, before others."""
    return candidate.untried is not None, -candidate.least, -candidate.delta_bic


def find_why_unnamed(candidate: Candidate) -> Against | None:
    """Why a fitted effect is not named: its numbers end where nobody measured them."""
    model = candidate.model
    assert model is not None
    own = f"{candidate.name}__"
    # Of numbers at which it does nothing; others, such as how sudden a change is, may end anywhere.
    effect = dict(model.effects.steps)[candidate.name]
    sizes = [p.name for p in effect.free if p.name in effect.neutral or not effect.neutral]
    values, ends, unknown = model.values(), model.at_bound(), model.undetermined()
    highest = dict(zip(model.simulator.names, model.simulator.high.tolist(), strict=True))
    for name, value in effect.unseen_at.items():
        at = min(value, highest.get(own + name, np.inf))
        if own + name in ends and np.isclose(values[own + name], at, rtol=AT_BOUND):
            text = f"nothing shows of it with {name} = {at:.3g}"
            return Against(Reason.NOT_SEEN, text)
    lost = [name for name in sizes if own + name in unknown]
    at_end = [n for n in sizes if own + n in ends and not is_natural_bound(values[own + n])]
    if not sizes or {*lost, *at_end} != {*sizes}:
        return None
    if lost:
        return Against(Reason.NOT_DETERMINED, f"the data do not determine its {', '.join(lost)}")
    return Against(Reason.AT_BOUND, f"{', '.join(at_end)} at the bound")


def find_why_zero(candidate: Candidate) -> Against | None:
    """Why a smooth effect is not named: its numbers may well be those at which it does nothing."""
    model, neutral = candidate.model, candidate.effect.neutral
    assert model is not None
    if not neutral or candidate.effect.free_form or not model.simulator.smooth:
        return None
    free = {p.name for p in dict(model.effects.steps)[candidate.name].free}
    values, names = model.values(), model.simulator.names
    sd = dict(zip(names, np.sqrt(np.diag(model.covariance())), strict=True))
    numbers = []
    for name in (name for name in neutral if name in free):
        value, unsure = values[f"{candidate.name}__{name}"], sd[f"{candidate.name}__{name}"]
        if not abs(value - neutral[name]) < SURE * unsure:
            return None
        numbers.append(f"{name} = {value:.2g} ± {unsure:.1g}")
    if not numbers:
        return None
    text = f"within its standard errors it may be zero: {', '.join(numbers)}"
    return Against(Reason.MAY_BE_ZERO, text)


def is_natural_bound(value: float) -> bool:
    """Whether a bound is a value like others: no delay, no leak; a lapse that is complete."""
    return abs(value) < AT_ZERO or abs(value - 1.0) < AT_BOUND


def mark_confused(candidates: list[Candidate]) -> None:
    """Note for each candidate that counts which others do within the threshold."""
    passing = [c for c in candidates if c.passes]
    for c in passing:
        c.confused_with = [
            o.effect.name for o in passing if o is not c and abs(find_lead(o, c)) <= THRESHOLD
        ]


def find_lead(one: Candidate, other: Candidate) -> float:
    """Nats by which one candidate leads another: the least of judges that know both."""
    shared = [
        one.evidence[judge] - other.evidence[judge]
        for judge in one.evidence.keys() & other.evidence.keys()
    ]
    return float(min((lead for lead in shared if not np.isnan(lead)), default=0.0))


def find_why_not(candidate: Candidate, winner: str, *, taken_out: bool) -> Against:
    """Why a candidate is not part of what was found; ``winner`` is what its step added, or none."""
    c = candidate
    if c.untried is not None:
        return c.untried
    if c.refused is not None:
        return c.refused
    if not c.passes and c.judge != HELD_OUT:
        code = Reason.TOO_LITTLE if c.judge in ("", FREE_RUN) else Reason.REFUTED
        granted = f"{c.least:.1f} nats ({c.judge})" if c.judge else "nothing"
        text = f"its evidence is {granted}, needs more than {THRESHOLD:g}"
        return Against(code, text)
    if not c.passes:
        # What gains too little on the rows of its fit was not held out.
        rows = "the rows of the fit" if c.prediction is None else "held-out rows"
        text = f"{c.gain:+.3g} points on {rows}, needs at least {c.least_gain:.2g}"
        return Against(Reason.TOO_LITTLE, text)
    if c.begun:
        text = f"it may have {max(c.hoped, 0.0):.0f} nats at most: too little beside others"
        return Against(Reason.NOT_FOLLOWED, text)
    if taken_out:
        return Against(Reason.SUPERFLUOUS, "it no longer pays once the later effects are added")
    if winner:
        text = f"it improves the free run too; {title_of(winner)} was added instead"
        return Against(Reason.RIVAL, text)
    return Against(Reason.CUT_SHORT, "it pays, but max_effects was reached")
