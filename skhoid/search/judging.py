"""What counts: the rules and thresholds by which a search adds, refuses and names effects.

What they are applied to is measured in :mod:`skhoid.search.judges`. What is worth computing, such
as how many rivals are followed, stands where it is computed.

A candidate has several ΔBICs over its parent, and the larger is the better:

``delta_bic``
    Both under one noise model, that of the best of the step.
``joint``
    Each with the noise model that is likeliest with it: unbiased. NaN where it is not asked.
``in_loop.delta_bic``
    In the closed loop, in which no remnant returns in the error.
``ranking_bic``
    ``delta_bic / 2 + joint`` (``delta_bic`` where ``joint`` is NaN), less what the loop has against
    an effect that is not linear.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..diagnosis.leaks import SLOPE, LeakTest
from ..effects.base import Effect
from ..effects.registry import title_of
from ..model.model import AT_BOUND, Model
from .judges import InLoop
from .statuses import Against, Ending, Reason, Verdict

if TYPE_CHECKING:
    from .leftover import SearchNumbers

LEAST_DELTA_BIC = 25.0  # of an effect that counts
LEAST_GAIN = 0.2  # VAF points on held-out rows of an effect that counts
OF_TARGET = ("feedforward", "preview")  # what the remnant imitates most
CLEAR, CERTAIN = 0.5, 100.0  # points and ΔBIC in the loop, that it imitates hardly ever
MUCH = 5.0  # points, of what neither a likelihood nor the loop knows
MORE, MORE_DELTA_BIC = 0.5, 60.0  # gain and ΔBIC that count beside a loop that is blind
BLIND = 0.1  # points of VAF that are no loss in the loop
LITTLE_NOISE = 97.0  # % of VAF, above which an effect must gain more than a plainer one
AS_GOOD = 0.05  # points
SURE = 3.0  # standard errors, by which an effect's numbers are off those at which it does nothing
AT_ZERO = 1e-9  # rounding of a bound
MOST_UNBIASED = 1.5  # times ΔBIC, of a ranking ΔBIC that is about as large usually
MAY_BE_BEST = 0.5  # of the ranking ΔBIC of the best, for another that may be it once it is known
RIVAL = 0.3  # of the ranking ΔBIC of the best, at least, of another that may be it
N_RIVALS = 3  # which the closed loop compares with the best
CONFUSED = 12.0  # of ΔBIC, within which two effects are not told apart
TRACE_LEADS = 0.5  # points of VAF that another may gain more than what a trace shows
NOTED = 0.2  # points of structure that is left
LEFT_SURELY = 4.0  # standard errors by which what is left exceeds nothing
P_OF_CHANGE = 0.005  # of a parameter that changes too: two are tested, which makes 0.01 for both

# In the closed loop: of an effect that counts; of one that gains so many points there.
LOOP_DELTA_BIC, LOOP_GAIN = 20.0, 0.1
LOOP_DELTA_BIC_IF_BETTER, MUCH_BETTER = 5.0, 0.3
# ΔBIC asked with a noise model that is estimated along: usually; of the first; beside what bends.
LIKELY, LIKELY_IF_FIRST, LIKELY_BESIDE_BENT = 25.0, 12.0, 50.0


class LeftBeside(NamedTuple):
    """How much structure may be left beside effects that are named.

    It counts as structure that nothing explains if it is at least ``points`` (of VAF about the
    mean) and more than the share ``counts`` of what could be explained. Names are dropped if it is
    more than the share ``unnames`` too; the limit rises with what the effects gain, to
    ``unnames_much`` for 10 points, since hardly anything else imitates as much.
    """

    points: float
    counts: float
    unnames: float
    unnames_much: float


BESIDE_ONE = LeftBeside(points=0.6, counts=0.1, unnames=0.12, unnames_much=0.5)
BESIDE_SEVERAL = LeftBeside(points=0.4, counts=0.04, unnames=0.04, unnames_much=0.25)
MUCH_GAINED = 10.0  # points about the mean, for which the last share holds
AS_GOOD_FORM = 0.1  # points
BEHIND, LINEAR = "behind the muscles' delay", "linear"
# A linear answer may be a delay, dynamics or a path, and a path may answer the size of the error.
GROUPS = {
    "delay": frozenset({LINEAR}),
    "path": frozenset({LINEAR, "input"}),
    "command": frozenset({LINEAR, BEHIND}),
    "spring": frozenset({BEHIND}),
    "output": frozenset({BEHIND}),
    "inside": frozenset({BEHIND}),
}
LEAST_GAIN_OF_CLAIM = 0.6  # VAF points: a little delay makes up for much that is not one
CLAIM = "wrong_delay"  # the effect by which a given delay is freed


def refutes(judged: InLoop) -> bool:
    """Whether the loop is known, and the model no better than the parent there."""
    if judged.bends:
        return judged.delta_bic < -LOOP_DELTA_BIC
    least = LOOP_DELTA_BIC_IF_BETTER if judged.gain >= MUCH_BETTER else LOOP_DELTA_BIC
    return judged.delta_bic <= least or judged.gain < LOOP_GAIN


def likely_asked(judged: InLoop) -> float:
    """ΔBIC asked with a noise model: less of a first effect that bends, more beside such."""
    if judged.parent_has == "nothing" and judged.bends:
        return LIKELY_IF_FIRST
    unsolved = bool(np.isnan(judged.delta_bic))
    if unsolved and (judged.parent_has == "bent" or judged.bends is False):
        return LIKELY_BESIDE_BENT
    return LIKELY


def loop_against(judged: InLoop | None) -> float:
    """ΔBIC that the loop has against a model that is not linear."""
    return max(-judged.delta_bic, 0.0) if judged is not None and judged.bends else 0.0


@dataclass
class Candidate:
    """An effect tried in addition to a parent, under a name there, and the result."""

    name: str
    effect: Effect
    model: Model | None = None
    inapplicable: str = ""  # what it needs and the data do not have
    delta_bic: float = -np.inf
    n_parameters: float = 0
    vaf: float = -np.inf
    gain: float = -np.inf
    p_value: float = 1.0
    prediction: np.ndarray | None = None
    confused_with: list[str] = field(default_factory=list)
    trace: str = ""
    joint: float = np.nan
    in_loop: InLoop | None = None
    least_gain: float = LEAST_GAIN
    refused: Against | None = None
    lacks_joint: bool = False

    @property
    def passes(self) -> bool:
        """All criteria are met, or the output itself shows the effect."""
        return self.pays and (bool(self.trace) or not self.refuted)

    @property
    def pays(self) -> bool:
        """Whether it explains the rows better, whatever the closed loop says."""
        if self.refused:
            return False
        return self.gain > -self.least_gain if self.trace else self.helps

    @property
    def refuted(self) -> bool:
        """Whether the unbiased likelihood and the closed loop, if evaluated, speak against it.

        The loop decides on linear effects, and on others only against them; else the noise model
        does. In the loop a linear model meets no remnant, so an effect that only the remnant
        excites shows nothing there: much outside the loop counts for it, if it loses nothing in
        it. Of effects at place "inside" the loop decides all the same.
        """
        judged = self.in_loop
        if judged is None:
            return False
        if np.isnan(judged.delta_bic) and np.isnan(self.joint):
            # No likelihood has a maximum with it, and no loop: only much is more than chance.
            return judged.bends is not None and self.gain < MUCH
        likely = min(self.joint, self.ranking_bic)
        if np.isnan(judged.delta_bic):
            return likely <= likely_asked(judged)
        if self.effect.name in OF_TARGET and not judged.bends:
            # The target excites it in the loop too. With no such effect in the data, ΔBIC there
            # still reached 80, but the VAF hardly rose.
            least = LOOP_DELTA_BIC_IF_BETTER if judged.gain >= CLEAR else CERTAIN
            return judged.delta_bic <= least or judged.gain < LOOP_GAIN
        if np.isnan(self.joint) or not judged.bends:
            blind = self.effect.place != "inside" and judged.gain > -BLIND
            much = blind and self.gain >= MORE and likely > MORE_DELTA_BIC
            return refutes(judged) and not much
        return self.joint - loop_against(judged) <= likely_asked(judged)

    @property
    def linear_in_loop(self) -> bool:
        """Whether the closed loop has judged it as a linear effect."""
        judged = self.in_loop
        return judged is not None and bool(np.isfinite(judged.delta_bic)) and not judged.bends

    @property
    def ranking_bic(self) -> float:
        """ΔBIC by which candidates are ranked, with the unbiased one where it is known."""
        unbiased = self.joint if np.isfinite(self.joint) else self.delta_bic / 2
        return self.delta_bic / 2 + unbiased - loop_against(self.in_loop)

    @property
    def ranking_bic_at_most(self) -> float:
        """What that may be once the unbiased ΔBIC, usually half of ``delta_bic``, is known."""
        if not self.lacks_joint:
            return self.ranking_bic
        return MOST_UNBIASED * max(self.delta_bic, 0.0) + LEAST_DELTA_BIC

    @property
    def follows(self) -> bool:
        """Whether it follows the measured error better, by likelihood and on held-out rows."""
        return self.delta_bic > LEAST_DELTA_BIC and self.gain >= self.least_gain

    @property
    def helps(self) -> bool:
        """The same, or by an unbiased likelihood."""
        return self.follows or (self.joint > LEAST_DELTA_BIC and self.gain >= self.least_gain)


def may_lead(candidates: list[Candidate], share: float) -> list[Candidate]:
    """Candidates without an unbiased ΔBIC that may have a ``share`` of the best's ranking ΔBIC."""
    most = [c.ranking_bic_at_most for c in candidates if c.passes and not c.lacks_joint]
    left = [c for c in candidates if c.lacks_joint]
    known: dict[str, float] = {}
    for c in candidates:
        if not c.lacks_joint and np.isfinite(c.joint):
            known[c.name] = max(c.ranking_bic, known.get(c.name, -np.inf))
    if not most:  # the likeliest shows how much others have to be
        return sorted(left, key=lambda c: -c.ranking_bic_at_most)[:1]
    least = share * max(most)
    return [c for c in left if c.ranking_bic_at_most > min(least, known.get(c.name, np.inf))]


def likeliest_alternatives(candidates: list[Candidate]) -> list[Candidate]:
    """For each effect the alternative that explains most, in the order of the effects."""

    def worth(candidate: Candidate) -> tuple[bool, bool, float]:
        gains = candidate.gain >= candidate.least_gain
        return not candidate.refused, gains, candidate.ranking_bic

    found: dict[str, Candidate] = {}
    for one in candidates:
        if one.name not in found or worth(one) > worth(found[one.name]):
            found[one.name] = one
    return list(found.values())


def order_key(candidate: Candidate) -> tuple[bool, bool, float]:
    """Key of the order: what the output shows, what passes, and then by ΔBIC."""
    passes = candidate.passes
    trace = passes and bool(candidate.trace)
    return not trace, not passes, -(candidate.ranking_bic if passes else candidate.delta_bic)


def leaks_beyond(leak: LeakTest | None, of_parent: LeakTest | None) -> Against | None:
    """What the leak test says about a model, unless it says much the same about the parent."""
    if leak is None or not leak.leaks:
        return None
    known = of_parent.slope if of_parent is not None and of_parent.leaks else -np.inf
    return None if leak.slope < known + SLOPE else Against(Reason.REBUILDS, leak.reason)


def find_why_unnamed(candidate: Candidate) -> Against | None:
    """Why a fitted effect is not named: its numbers end where nobody measured them."""
    model = candidate.model
    assert model is not None
    own = f"{candidate.name}__"
    # Of numbers at which it does nothing; others, such as how sudden a change is, may end anywhere.
    effect = dict(model.effects.steps)[candidate.name]
    sizes = [p.name for p in effect.free if p.name in effect.neutral or not effect.neutral]
    values, ends, unknown = model.values(), model.at_bound(), model.undetermined()
    for name, value in effect.unseen_at.items():
        if own + name in ends and np.isclose(values[own + name], value, rtol=AT_BOUND):
            text = f"nothing shows of it with {name} = {value:g}"
            return Against(Reason.NOT_SEEN, text)
    lost = [name for name in sizes if own + name in unknown]
    at_end = [n for n in sizes if own + n in ends and not is_natural_bound(values[own + n])]
    if not sizes or {*lost, *at_end} != {*sizes}:
        return None
    if lost:
        return Against(Reason.NOT_DETERMINED, f"the data do not determine its {', '.join(lost)}")
    return Against(Reason.AT_BOUND, f"{', '.join(at_end)} at the bound")


def hardly_there(candidate: Candidate) -> Against | None:
    """Why a smooth effect is not named: its numbers may well be those at which it does nothing."""
    model, neutral = candidate.model, candidate.effect.neutral
    assert model is not None
    if not neutral or candidate.effect.free_form or not model.simulator.smooth:
        return None
    free = {p.name for p in dict(model.effects.steps)[candidate.name].free}
    sizes = [name for name in neutral if name in free]
    values, names = model.values(), model.simulator.names
    sd = dict(zip(names, np.sqrt(np.diag(model.covariance())), strict=True))
    numbers = []
    for name in sizes:
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


def plainest_first(candidates: list[Candidate]) -> None:
    """Put a plainer effect before the best where too little noise is left to tell them apart."""
    first = candidates[0] if candidates else None
    if first is None or not first.passes or first.trace or first.vaf < LITTLE_NOISE:
        return
    plainer = [
        c
        for c in candidates
        if c.passes and c.gain > first.gain - AS_GOOD and c.n_parameters < first.n_parameters
    ]
    if plainer:
        best = min(plainer, key=lambda c: (c.n_parameters, -c.ranking_bic))
        candidates.remove(best)
        candidates.insert(0, best)


def mark_confused(candidates: list[Candidate]) -> None:
    """Note for each candidate which others explain as much."""
    for c in candidates:
        c.confused_with = [
            o.effect.name
            for o in candidates
            if o is not c
            and o.passes
            and c.passes
            and abs(o.ranking_bic - c.ranking_bic) < CONFUSED
        ]


def find_special_cases(general: Candidate, candidates: list[Candidate]) -> list[Candidate]:
    """Candidates that a general form contains, so far as they pass, the likeliest first."""
    special = [c for c in candidates if general.effect.name in c.effect.within and c.passes]
    return sorted(special, key=lambda c: -c.ranking_bic)


def as_good(special: Candidate, general: Candidate) -> bool:
    """Whether what a general form has beyond a special case would not count as an effect.

    A general form also takes up errors of the simulation and of the noise model, so that ΔBIC
    prefers it in long records, whatever is true: the closed loop decides if it can, then points
    too.
    """
    one, other = special.in_loop, general.in_loop
    if one is not None and other is not None and special.linear_in_loop and general.linear_in_loop:
        more, gain = other.delta_bic - one.delta_bic, other.gain - one.gain
        if more <= LOOP_DELTA_BIC or gain < LOOP_GAIN:
            return True
    joint, more = general.joint - special.joint, general.ranking_bic - special.ranking_bic
    if general.n_parameters > special.n_parameters:
        fewer_points = general.gain - special.gain < special.least_gain
        return bool(more <= LEAST_DELTA_BIC or fewer_points)
    return bool((joint if np.isfinite(joint) else more) <= LEAST_DELTA_BIC)


def against_candidate(candidate: Candidate, winner: str, *, taken_out: bool) -> Against:
    """Why a candidate is not part of what was found; ``winner`` is what its step added, or none."""
    c = candidate
    if c.inapplicable:
        return Against(Reason.REFUSED, c.inapplicable)
    if c.refused is not None:
        return c.refused
    if not c.passes:
        loses = c.refuted and (c.trace or c.helps)
        return Against(Reason.REFUTED, speaks_against(c)) if loses else falls_short(c)
    if taken_out:
        return Against(Reason.SUPERFLUOUS, "it no longer pays once the later effects are added")
    if winner:
        text = f"it improves the free run too; {title_of(winner)} was added instead"
        return Against(Reason.RIVAL, text)
    return Against(Reason.CUT_SHORT, "it pays, but max_effects was reached")


def falls_short(candidate: Candidate) -> Against:
    """Which criteria of the free run are not met, with what was found and what is asked."""
    found = []
    if not candidate.delta_bic > LEAST_DELTA_BIC:
        found.append(f"ΔBIC {candidate.delta_bic:.1f}, needs more than {LEAST_DELTA_BIC:g}")
    if not candidate.gain >= candidate.least_gain:
        # What gains too little on the rows of its fit was not held out.
        rows = "the rows of the fit" if candidate.prediction is None else "held-out rows"
        found.append(
            f"{candidate.gain:+.3g} points on {rows}, needs at least {candidate.least_gain:.2g}"
        )
    return Against(Reason.TOO_LITTLE, "; ".join(found))


def speaks_against(candidate: Candidate) -> str:
    """Why a candidate that fits the measured error better is not added."""
    found, judged = [], candidate.in_loop
    if judged is not None and judged.delta_bic == -np.inf:
        return "the closed loop does not settle with it"
    if candidate.joint <= LEAST_DELTA_BIC:
        found.append(f"estimated together with a noise model, it has ΔBIC {candidate.joint:.0f}")
    if judged is not None and np.isfinite(judged.gain):
        verdict = "no better" if judged.gain <= 0.0 else "hardly better"
        found.append(
            f"in the closed loop it is {verdict} ({judged.gain:+.2f} points, ΔBIC "
            f"{judged.delta_bic:.0f})"
        )
    if not found and np.isnan(candidate.joint):
        found.append("neither a likelihood nor the closed loop confirms it")
    elif not found:
        likely = min(candidate.joint, candidate.ranking_bic)
        found.append(f"the loop is not known with it, and it has ΔBIC {likely:.0f}")
    return f"{'; '.join(found)}: it may follow the remnant that returns in the error"


def decided(found: SearchNumbers, *, tries_all: bool) -> Ending:
    """Whether what was found can be named, and whether something else is missing."""
    ids, stand_ins, worst = found.ids, [], found.worst
    share = worst / max(worst + found.gained, 1e-300)
    limits = BESIDE_SEVERAL if len(found.added) > 1 else BESIDE_ONE
    large = largest_left(limits, found.gained, found)
    left = worst >= limits.points * found.share and share > limits.counts
    if not (left or found.one_cause):
        return Ending(Verdict.FOUND if ids else Verdict.NOTHING, ids, [])
    if found.one_cause:
        ids, stand_ins = [], ids
    elif share > large:
        kept = 1 if len(found.added) > 1 and first_explains(found) else 0
        ids, stand_ins = ids[:kept], ids[kept:]
    if found.path.steps[-1].best is not None:
        return Ending(Verdict.CUT_SHORT, ids, stand_ins)
    return Ending(unnamed_verdict(tries_all), ids, stand_ins)


def unnamed_verdict(tries_all: bool) -> Verdict:
    """The verdict of a search that leaves something without a name."""
    return Verdict.NOT_IN_CATALOGUE if tries_all else Verdict.NOT_TRIED


def first_explains(found: SearchNumbers) -> bool:
    """Whether the first effect would stay named on its own: later ones take nothing from it."""
    gained = found.steps[1].vaf - found.steps[0].vaf
    left = found.worst + found.gained - gained
    return left <= largest_left(BESIDE_ONE, gained, found) * (left + gained)


def largest_left(limits: LeftBeside, gained: float, found: SearchNumbers) -> float:
    """Share of what could be explained that may be left when a named effect gains so much."""
    return max(limits.unnames, limits.unnames_much * min(gained / (MUCH_GAINED * found.share), 1.0))


def first_stands(rival: Candidate, found: SearchNumbers) -> bool:
    """Whether the first effect acts where a form does, and leaves little of what that explains."""
    first = dict(found.path.model.effects.steps)[found.added[0]]
    left = rival.gain - (found.steps[1].vaf - found.steps[0].vaf)
    return (
        bool(find_group(rival.effect) & find_group(first))
        and left <= BESIDE_ONE.counts * rival.gain
    )


def excess_asked(one: Candidate, found: SearchNumbers) -> float:
    """Points by which a form must exceed all effects found to speak against them."""
    if len(found.added) > 1:
        return -AS_GOOD_FORM
    if not elsewhere(one.effect, found):
        return found.share * BESIDE_ONE.points
    named, form = found.path.model, one.model
    plainer = form is not None and form.n_parameters < named.n_parameters
    return -AS_GOOD_FORM if plainer else found.share * LEAST_GAIN


def elsewhere(form: Any, found: SearchNumbers) -> bool:
    """Whether a form acts elsewhere than all effects that were found."""
    effects = dict(found.path.model.effects.steps)
    own = find_group(form)
    return all(not own & find_group(effects[name]) for name in found.added)


def find_group(effect: Effect) -> frozenset[str]:
    """What an effect changes, so far as data tell places apart."""
    return GROUPS.get(effect.place, frozenset({effect.place}))


def evidence_for(c: Candidate) -> float:
    """The least ΔBIC granted by a judge that the remnant in the error cannot mislead."""
    if c.inapplicable or c.model is None:
        return np.nan
    judged, found = c.in_loop, [c.delta_bic]
    if np.isfinite(c.joint):
        found.append(c.joint)
    if judged is not None and not np.isnan(judged.delta_bic):
        if not judged.bends:
            found = [judged.delta_bic]
            if c.effect.name in OF_TARGET and judged.gain < LOOP_GAIN:
                found.append(0.0)
        else:
            found = [one - loop_against(judged) for one in found]
    least = float(min(found))
    return least if c.gain > 0 else min(least, 0.0)
