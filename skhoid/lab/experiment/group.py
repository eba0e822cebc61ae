"""GroupEffectSearch: which effects people share, and who is different."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest
from sklearn.base import BaseEstimator, clone
from sklearn.utils.validation import check_is_fitted

from ... import EffectSearchCV, OperatorRegressor
from ..._sklearn import Interval, fit_context
from ...effects import Effect, Effects, title_of, titles_of
from ...model import simulated_model
from ...pipelines import taken_apart
from ...search import EVIDENCE_COLUMNS, Status, evidence_of, log_factor
from ...text import Document, Item, Items, Note, Notes, Paragraph, Summary, counted, p_text
from ..studies.identity import described
from ..studies.store import Store, uniform
from ..studies.workers import completed
from .groups import ALL, Group, listed, read_groups
from .identify import identify_people
from .mixed import holm
from .people import COLUMNS as PEOPLE_COLUMNS
from .prevalence import PersonEvidence, Prevalence, prevalences, summed

STANDS_IN = "unknown"


@dataclass(frozen=True)
class EvidenceJob:
    """What a worker is given."""

    search: EffectSearchCV
    found: Effects
    effects: list[Effect]
    group: Group
    ranking: pd.DataFrame

    def __str__(self) -> str:
        return str(self.group)


def weigh_person(job: EvidenceJob) -> pd.DataFrame:
    """The table of evidence of one person in one condition."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the search of the same runs has said it
        group = job.group
        table = evidence_of(job.search, job.found, job.effects, group.X, group.y, job.ranking)
    return uniform(table)


def named_by(search: EffectSearchCV) -> Effects:
    """Effects that a fitted search named, with their choices; not those that only stand in."""
    named = [name for name in search.best_effects_ if name != STANDS_IN]
    steps = search.best_estimator_.effects_
    kept = [(name, effect) for name, effect in steps if effect.name in named]
    templates = search.best_estimator_.effects
    chosen = dict(Effects.of(templates).steps) if templates is not None else {}
    return Effects([(name, chosen.get(name, effect)) for name, effect in kept])


def as_answered(search: EffectSearchCV, fitted: EffectSearchCV) -> EffectSearchCV:
    """The search, unfitted, which need not find again whether a person or a machine answers."""
    model = taken_apart(fitted.best_estimator_)[1]
    if not isinstance(model, OperatorRegressor):
        return clone(search)
    return clone(search).set_params(domain="machine" if model.controller else "human")


def list_candidates(searches: list[EffectSearchCV]) -> list[Effect]:
    """Effects to weigh in everybody: what a search named, and what all of them together suggest.

    The rows of the last step of each search are a preview of its evidence.
    """
    named = {name for search in searches for name in search.best_effects_} - {STANDS_IN}
    total: dict[str, float] = {}
    tried = {one.name: one for one in searches[0].list_effects()}
    for search in searches:
        rows = search.ranking_
        last = rows[(rows["step"] == rows["step"].max()) & (rows["status"] != Status.REFUSED)]
        for _, row in last.iterrows():
            known = np.isfinite(row["evidence"]) and row["effect"] not in search.best_effects_
            if known:
                factor = log_factor(tried[row["effect"]], float(row["evidence"]))
                total[row["effect"]] = total.get(row["effect"], 0.0) + factor
    suggested = {name for name, factor in total.items() if factor > 0.0}
    wanted = named | suggested
    return [one for one in tried.values() if one.name in wanted and not one.noise]


def weigh(
    jobs: list[EvidenceJob],
    folder: str | os.PathLike[str] | None,
    n_jobs: int | None,
    progress: bool | None,
) -> list[pd.DataFrame]:
    """The tables of all jobs, from the folder where they are there."""
    first = jobs[0]
    if not first.effects:
        return [pd.DataFrame(columns=EVIDENCE_COLUMNS) for _ in jobs]
    store = None
    if folder is not None:
        description = {
            "task": "evidence for effects",
            "search": described(first.search),
            "effects": [described(effect) for effect in first.effects],
            "groups": [[str(job.group), job.group.identity(), repr(job.found)] for job in jobs],
        }
        store = Store(folder, description)
    tables = completed(
        dict(enumerate(jobs)),
        weigh_person,
        store,
        n_jobs=n_jobs,
        progress=progress,
        what="evidence",
    )
    return [table.reindex(columns=EVIDENCE_COLUMNS) for table in tables]


def member_parameters(
    search: EffectSearchCV,
    groups: list[Group],
    searches: dict[tuple[Any, Any], EffectSearchCV],
    members: pd.DataFrame,
) -> pd.DataFrame:
    """A tidy table of the parameters of each person's effects, core parameters included.

    Who is taken to have other effects than the search named is fitted again with these.
    """
    rows = []
    for group in groups:
        key = group.subject, group.condition
        here = (members["subject"] == key[0]) & (members["condition"] == key[1]) & members["has"]
        wanted = list(members.loc[here, "effect"])
        done, failure = searches[key].best_estimator_, ""
        # Of the best model, those included that only stand in for something without a name.
        own = Effects.of(getattr(search.estimator, "effects", None)).names
        found = [e.name for name, e in done.effects_ if name not in own]
        if sorted(wanted) != sorted(found):
            done, failure = _fitted(search, searches[key], wanted, group)
        fixed = {"run": "all", "n_rows": len(group.y), "ceiling": np.nan, "outlying": ""}
        who = {"subject": key[0], "condition": key[1], **fixed, "failure": failure}
        if done is None:
            rows.append({**who, "parameter": "", "estimate": np.nan, "se": np.nan, "unit": ""})
            continue
        vaf = float(done.score(group.X, group.y))
        for name, row in taken_apart(done)[1].parameters_.iterrows():
            numbers = {"estimate": float(row["value"]), "se": float(row["sd"]), "vaf": vaf}
            unit = "" if row["unit"] in (None, "-") else str(row["unit"])
            rows.append({**who, "parameter": str(name), **numbers, "unit": unit})
    return pd.DataFrame(rows, columns=list(PEOPLE_COLUMNS))


def _fitted(
    search: EffectSearchCV, own: EffectSearchCV, wanted: list[str], group: Group
) -> tuple[Any, str]:
    """The model with other effects than a search named: its choices where it has made them."""
    chosen = {effect.name: effect for _, effect in named_by(own)}
    plain = {one.name: one for one in own.list_effects()}
    effects = [chosen.get(name, plain.get(name)) for name in wanted]
    model = clone(simulated_model(search.estimator, "GroupEffectSearch"))
    given = Effects.of(getattr(model, "effects", None))
    more = Effects.of([effect for effect in effects if effect is not None])
    model.set_params(effects=given + more)
    if search.controlled_element is not None:
        model.set_params(controlled_element=search.controlled_element)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return model.fit(group.X, group.y), ""
        except Exception as error:
            return None, f"{type(error).__name__}: {error}"


CONTRAST_COLUMNS = ["effect", "condition", "other", "n_people", "n_with", "n_other"]
CONTRAST_COLUMNS += ["only_here", "only_there", "p"]


def condition_contrasts(members: pd.DataFrame) -> pd.DataFrame:
    """For each effect and pair of conditions an exact McNemar test over people with both."""
    rows = []
    for effect, table in members.groupby("effect", sort=False):
        has = table.pivot_table(
            index="subject", columns="condition", values="has", sort=False, aggfunc="first"
        )
        for here, there in combinations(has.columns, 2):
            both = has[[here, there]].dropna().astype(bool)
            a, b = both[here].to_numpy(), both[there].to_numpy()
            only_here, only_there = int((a & ~b).sum()), int((~a & b).sum())
            n = only_here + only_there
            p = float(binomtest(only_here, n).pvalue) if n else 1.0
            row = (effect, here, there, len(both), int(a.sum()), int(b.sum()))
            rows.append((*row, only_here, only_there, p))
    found = pd.DataFrame(rows, columns=CONTRAST_COLUMNS)
    return found.assign(p_adjusted=holm(found["p"].to_numpy(dtype=float)))


SURE = 0.95  # probability of a prevalence above the least, at which an effect is the group's
LIKELY = 0.5  # probability above which a person is taken to have an effect
KEY = ["subject", "condition"]


class GroupEffectSearch(BaseEstimator):
    """Find the effects that people share, judged by the evidence of all of them.

    A search is made for each person in each condition. Then every candidate is weighed in
    everybody, and its prevalence, the share of people who have it, is estimated from the evidence
    of all. An effect is named for the group where more than ``least_prevalence`` of people have it
    with a probability of 95 %: the evidence of one person, however large, does not suffice. An
    effect too weak to be named in anybody may be named for the group.

    Parameters
    ----------
    search : EffectSearchCV
        The search for one person, unfitted.
    least_prevalence : float, default=0.25
        Share of people, more than which must have an effect of the group.
    folder : path or None, default=None
        Folder for what is finished. A call that was stopped goes on where it was.
    n_jobs : int or None, default=None
        Number of people to search at a time, as in joblib.
    progress : bool or None, default=None
        Show progress bars; without a terminal a line for each person and condition. None means
        only in a terminal.

    Attributes
    ----------
    group_effects_ : list of str
        Ids of the effects named for the group, in all conditions or in some; most prevalent first.
    prevalence_ : DataFrame
        One row per effect and condition (``"all"``: evidence of all conditions together, as if a
        person had an effect in all of them or in none): effect, title, condition, n_people (whose
        data can tell), n_with, share, low, high (prevalence and its 95 % interval), p_group
        (probability that it exceeds ``least_prevalence``), group (whether it is named), with_it,
        without (lists of subjects).
    members_ : DataFrame
        One row per person, condition and effect: subject, condition, effect, probability, named
        (by the search of these runs alone), has (probability above one half).
    parameters_ : DataFrame
        Tidy table of the parameters of each effect where it is taken to be: as
        ``PeopleResult.table``, with ``run`` ``"all"``.
    contrasts_ : DataFrame
        Conditions compared by who has an effect: effect, condition, other, n_people, n_with,
        n_other, only_here, only_there, p (exact McNemar test), p_adjusted (Holm). Empty with one
        condition.
    limits_ : DataFrame
        How large effects may be that the runs of a person do not name: subject, condition, and the
        columns of ``EffectSearchCV.limits_``.
    people_ : DataFrame
        One row per person and condition: subject, condition, effects (a tuple: named, with those
        that the group adds), verdict, vaf (held out, baseline), vaf_with, ceiling, failure.
    evidence_ : DataFrame
        What was weighed: subject, condition, instead_of, effect, evidence (nats), vaf_gain,
        free_run, likelihood, instruments, reason.
    searches_ : dict
        The fitted search of each (subject, condition).
    identified_ : PeopleResult
        Parameters of the best models, failures, and who looks wrong.

    Notes
    -----
    The Bayes factor B of a person for an effect is that of the map which gives names in
    ``ranking_`` their probability, against nothing, without the odds that the map begins with. With
    the prevalence r, the likelihood is the product over people of r B + 1 - r, and the prior of r
    is uniform. Sets of effects (what was named, with one more, without one, with one replaced) are
    weighed with the prevalences of all as prior odds, until nothing changes.

    References
    ----------
    Stephan et al., Bayesian model selection for group studies, NeuroImage 46, 2009.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
    >>> from skhoid import GroupEffectSearch
    >>> people = {}
    >>> for number in range(3):
    ...     X, y = make_tracking_runs("C1", n_runs=2, duration=20.48, random_state=number)
    ...     people[f"S{number + 1}"] = X, y + 0.05  # a push to one side
    >>> X = pd.concat({name: X for name, (X, _) in people.items()}, names=["subject"])
    >>> y = pd.concat({name: y for name, (_, y) in people.items()}, names=["subject"])
    >>> search = EffectSearchCV(OperatorRegressor(), effects=["bias"])
    >>> group = GroupEffectSearch(search).fit(X, y)
    >>> print(group.summary())
    The group has bias.
    <BLANKLINE>
    3 people.
    <BLANKLINE>
    - bias: 3 of 3 people, prevalence 80 % (40 to 99 %).
    """

    _parameter_constraints: dict = {
        "search": "no_validation",  # see fit
        "least_prevalence": [Interval(Real, 0.0, 1.0, closed="neither")],
        "folder": [str, os.PathLike, None],
        "n_jobs": [Integral, None],
        "progress": [bool, None],
    }

    def __init__(
        self,
        search: Any,
        *,
        least_prevalence: float = 0.25,
        folder: Any = None,
        n_jobs: int | None = None,
        progress: bool | None = None,
    ):
        self.search = search
        self.least_prevalence = least_prevalence
        self.folder = folder
        self.n_jobs = n_jobs
        self.progress = progress

    @fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: pd.DataFrame, y: Any) -> GroupEffectSearch:
        """Search in everybody, and ask what they share.

        Parameters
        ----------
        X : DataFrame of shape (n_rows, n_channels)
            Channels with the row index levels ``run`` and ``time`` (s), ``subject``, and
            ``condition`` if there is more than one.
        y : Series or array of shape (n_rows,)
            Control output.

        Returns
        -------
        self : GroupEffectSearch

        Raises
        ------
        TypeError
            If ``search`` is no EffectSearchCV.
        ValueError
            If there are fewer than two people, or no search succeeded.
        """
        if not isinstance(self.search, EffectSearchCV):
            raise TypeError(
                "GroupEffectSearch needs an EffectSearchCV, such as "
                f"EffectSearchCV(OperatorRegressor()); got {self.search!r}."
            )
        groups = read_groups(X, y)
        subjects = list(dict.fromkeys(group.subject for group in groups))
        if len(subjects) < 2:
            raise ValueError(
                "A group needs at least two people, told apart by the index level 'subject'; there "
                f"is one ({subjects[0]}). For one person use EffectSearchCV itself."
            )
        identified = identify_people(
            clone(self.search),
            X,
            y,
            each_run=False,
            folder=self._folder("searches"),
            n_jobs=self.n_jobs,
            progress=self.progress,
        )
        found = identified.models
        if not found:
            reasons = "; ".join(dict.fromkeys(identified.failures["failure"]))
            raise ValueError(f"No search succeeded: {reasons}")
        searched = [group for group in groups if (group.subject, group.condition) in found]
        self.identified_, self.searches_ = identified, found
        self._weigh(searched)
        self._count(searched)
        self.parameters_ = member_parameters(self.search, searched, found, self.members_)
        self.contrasts_ = condition_contrasts(self.members_)
        self.limits_ = pd.concat(
            [
                search.limits_.assign(
                    subject=pd.Series([who] * len(search.limits_), search.limits_.index, object),
                    condition=pd.Series(
                        [where] * len(search.limits_), search.limits_.index, object
                    ),
                )
                for (who, where), search in found.items()
            ],
            ignore_index=True,
        ).astype(dict.fromkeys(("limit", "limit_points", "shown_from", "shown_points"), float))
        self.people_ = self._people(groups)
        return self

    def _folder(self, name: str) -> Path | None:
        return None if self.folder is None else Path(self.folder) / name

    def _weigh(self, groups: list[Group]) -> None:
        """The evidence of everybody for and against all candidates."""
        searches = [self.searches_[group.subject, group.condition] for group in groups]
        effects = list_candidates(searches)
        self._effects = [effect.name for effect in effects]
        by_id = {effect.name: effect for effect in searches[0].list_effects()}
        jobs = [
            EvidenceJob(
                as_answered(self.search, search), named_by(search), effects, group, search.ranking_
            )
            for search, group in zip(searches, groups, strict=True)
        ]
        tables = weigh(jobs, self._folder("evidence"), self.n_jobs, self.progress)
        for table, group in zip(tables, groups, strict=True):
            table.insert(0, "condition", [group.condition] * len(table))
            table.insert(0, "subject", [group.subject] * len(table))
        self.evidence_ = pd.concat(tables, ignore_index=True)
        self._known = {
            (group.subject, group.condition): PersonEvidence(
                tuple(effect.name for _, effect in named_by(search)), table, by_id
            )
            for group, search, table in zip(groups, searches, tables, strict=True)
        }

    def _count(self, groups: list[Group]) -> None:
        """Prevalence and members in each condition, and over all of them."""
        conditions = list(dict.fromkeys(group.condition for group in groups))
        found: list[tuple[Any, list[Any], list[Prevalence]]] = []
        for condition in conditions:
            people = [group.subject for group in groups if group.condition == condition]
            known = [self._known[subject, condition] for subject in people]
            found.append((condition, people, prevalences(known, self._effects)))
        members = _members(found, self._known)
        if len(conditions) > 1:
            people = list(dict.fromkeys(group.subject for group in groups))
            cells = [
                [known for (subject, _), known in self._known.items() if subject == person]
                for person in people
            ]
            found.append((ALL, people, prevalences(summed(cells, self._effects), self._effects)))
        rows = [
            self._row(condition, people, one)
            for condition, people, all_of in found
            for one in all_of
            if one.n_people
        ]
        table = pd.DataFrame(rows, columns=_ROW).astype({"group": bool})
        order = {name: -table.loc[table["effect"] == name, "share"].max() for name in self._effects}
        table = table.sort_values("effect", key=lambda c: c.map(order), kind="stable")
        self.prevalence_ = table.reset_index(drop=True)
        self.members_ = members
        self.group_effects_ = list(dict.fromkeys(table.loc[table["group"], "effect"]))

    def _row(self, condition: Any, people: list[Any], one: Prevalence) -> dict[str, Any]:
        more = one.more_than(float(self.least_prevalence))
        several = one.n_with > 1
        told = [(who, has) for who, has in zip(people, one.has, strict=True) if np.isfinite(has)]
        return {
            "effect": one.effect,
            "title": title_of(one.effect),
            "condition": condition,
            "n_people": one.n_people,
            "n_with": one.n_with,
            "share": one.share,
            "low": one.low,
            "high": one.high,
            "p_group": more,
            "group": bool(more >= SURE and several),
            "with_it": [who for who, has in told if has > LIKELY],
            "without": [who for who, has in told if not has > LIKELY],
        }

    def _people(self, groups: list[Group]) -> pd.DataFrame:
        failed = self.identified_.failures.set_index(KEY)["failure"].to_dict()
        ceilings = self.identified_.groups.drop_duplicates(KEY).set_index(KEY)["ceiling"]
        members = self.members_[self.members_["has"]]
        rows = []
        for group in groups:
            key = group.subject, group.condition
            search = self.searches_.get(key)
            has = members[(members["subject"] == key[0]) & (members["condition"] == key[1])]
            path = None if search is None else search.error_path_["vaf"]
            rows.append(
                {
                    "subject": key[0],
                    "condition": key[1],
                    "effects": tuple(has["effect"]),
                    "verdict": None if search is None else search.verdict_,
                    "vaf": np.nan if path is None else float(path.iloc[0]),
                    "vaf_with": np.nan if path is None else float(path.iloc[-1]),
                    "ceiling": float(ceilings.get(key, np.nan)),
                    "failure": failed.get(key, ""),
                }
            )
        return pd.DataFrame(rows)

    def document(self) -> Document:
        """What the group shares, who is different, and what differs between conditions.

        Returns
        -------
        document : Document
        """
        check_is_fitted(self, "prevalence_")
        people = self.people_
        several = len([c for c in dict.fromkeys(people["condition"]) if c != ALL])
        what = counted(people["subject"].nunique(), "person").replace("persons", "people")
        what += f", {counted(several, 'condition')}" if several else ""
        lines = [*group_lines(self), *single_lines(self), *contrast_lines(self)]
        return Document(
            headline(self),
            [
                Paragraph(f"{what}."),
                Items([Item(line) for line in lines], numbered=False),
                Notes(list(notes(self))),
            ],
        )

    def summary(self) -> Summary:
        """The same as text.

        Returns
        -------
        text : Summary
            A string that notebooks show line by line.
        """
        return self.document().text()

    def plot(self, ax: Any = None) -> Any:
        """Draw who has which effect, and the prevalences.

        Parameters
        ----------
        ax : sequence of Axes or None, default=None
            Two Axes; None makes a figure.

        Returns
        -------
        display : GroupEffectsDisplay
        """
        from ...plotting import GroupEffectsDisplay

        return GroupEffectsDisplay.from_search(self, ax=ax)


_ROW = ["effect", "title", "condition", "n_people", "n_with", "share", "low", "high", "p_group"]
_ROW += ["group", "with_it", "without"]


def _members(
    found: list[tuple[Any, list[Any], list[Prevalence]]],
    known: dict[tuple[Any, Any], PersonEvidence],
) -> pd.DataFrame:
    rows = [
        {
            "subject": who,
            "condition": condition,
            "effect": one.effect,
            "probability": float(has),
            "named": one.effect in known[who, condition].named,
            "has": bool(has > LIKELY),
        }
        for condition, people, all_of in found
        for one in all_of
        for who, has in zip(people, one.has, strict=True)
        if np.isfinite(has)
    ]
    columns = ["subject", "condition", "effect", "probability", "named", "has"]
    return pd.DataFrame(rows, columns=columns).astype({"named": bool, "has": bool})


NOTED = 0.05  # p of a difference between conditions


def headline(found: GroupEffectSearch) -> str:
    """The verdict in one sentence."""
    if found.group_effects_:
        table = found.prevalence_[found.prevalence_["group"]]
        told: dict[str, list[str]] = {}
        for name in found.group_effects_:
            told.setdefault(_where(table[table["effect"] == name], found), []).append(name)
        parts = [f"{titles_of(names)}{where}" for where, names in told.items()]
        return f"The group has {'; '.join(parts)}."
    if len(found.members_) and found.members_["has"].any():
        return "No effect is the group's; single people have some."
    return "Nothing found, in the group or in anybody."


def _where(rows: pd.DataFrame, found: GroupEffectSearch) -> str:
    """In which conditions, where not in all."""
    here = [str(c) for c in rows["condition"] if c != ALL]
    others = len(set(found.people_["condition"]) - set(rows["condition"]))
    return f" in {listed(here)}" if here and others else ""


def group_lines(found: GroupEffectSearch) -> Iterator[str]:
    """Each effect of the group: how many people, the prevalence, and who does not show it."""
    for name in found.group_effects_:
        rows = found.prevalence_[found.prevalence_["effect"] == name]
        conditions = rows[rows["condition"] != ALL]
        if len(rows) == 1 or not conditions["group"].any():
            conditions = rows[rows["group"]]
        same = len(conditions) > 1 and len(set(map(str, conditions["with_it"]))) == 1
        for _, row in (conditions[:1] if same else conditions).iterrows():
            where = "" if row["condition"] == ALL else f" in {row['condition']}"
            where = f" in each of {len(conditions)} conditions" if same else where
            text = (
                f"{title_of(name)}{where}: {row['n_with']} of {row['n_people']} people, "
                f"prevalence {100 * row['share']:.0f} % ({100 * row['low']:.0f} to "
                f"{100 * row['high']:.0f} %)"
            )
            if row["group"] and row["without"]:
                places = None if same or row["condition"] == ALL else [row["condition"]]
                limit = tell_limit(found, name, row["without"], places)
                text += f"; not shown in {listed(row['without'])}{limit}"
            elif row["with_it"] and row["without"]:
                text += f"; only in {listed(row['with_it'])}"
            yield f"{text}."


def tell_limit(
    found: GroupEffectSearch, effect: str, people: Sequence[Any], conditions: Any = None
) -> str:
    """How large an effect may be in who does not show it, as " (up to 0.02 deg)"; "" if unknown.

    Of several people and conditions it is the largest.
    """
    table = getattr(found, "limits_", None)
    if table is None:
        return ""
    rows = table[(table["effect"] == effect) & table["subject"].isin(list(people))]
    if conditions is not None:
        rows = rows[rows["condition"].isin(conditions)]
    rows = rows[np.isfinite(rows["limit"])]
    if rows.empty:
        return ""
    rows = rows[rows["parameter"] == rows["parameter"].iloc[0]]
    unit = f" {rows['unit'].iloc[0]}" if rows["unit"].iloc[0] not in ("", "-") else ""
    if (rows["sense"] == "at least").all():
        return f" (at least {rows['limit'].min():.2g}{unit})"
    return f" (up to {rows['limit'].max():.2g}{unit})"


def single_lines(found: GroupEffectSearch) -> Iterator[str]:
    """In whom an effect is shown that is not the group's, and how large it may be in the others."""
    members = found.members_
    own = members[members["has"] & ~members["effect"].isin(found.group_effects_)]
    searched = found.people_.groupby("subject", sort=False).size()
    n = len(searched)
    for effect, table in own.groupby("effect", sort=False):
        people = list(dict.fromkeys(table["subject"]))
        where = [
            f"{who} (in {listed(list(rows['condition']))})" if len(rows) < searched[who] else who
            for who, rows in table.groupby("subject", sort=False)
        ]
        others = [who for who in dict.fromkeys(found.people_["subject"]) if who not in people]
        limit = tell_limit(found, str(effect), others)
        rest = f"; in the others it is not shown{limit}" if others else ""
        yield (
            f"{title_of(str(effect))} is shown in {listed(where)}, {len(people)} of {n} people"
            f"{rest}."
        )


def contrast_lines(found: GroupEffectSearch) -> Iterator[str]:
    """Which conditions differ in who has an effect."""
    for _, row in found.contrasts_[found.contrasts_["p_adjusted"] < NOTED].iterrows():
        yield (
            f"{title_of(row['effect'])}: {row['n_with']} of {row['n_people']} people in "
            f"{row['condition']}, {row['n_other']} in {row['other']} "
            f"({p_text(row['p_adjusted'])}, McNemar, Holm)."
        )


def leaves_unknown(people: pd.DataFrame) -> list[bool]:
    """Of which people something is missing that has no name; nothing is said of failed searches."""
    return [verdict is not None and verdict.leaves_unknown for verdict in people["verdict"]]


def notes(found: GroupEffectSearch) -> Iterator[Note]:
    """Whom nothing could be said about, and what has no name."""
    people = found.people_
    for _, row in people[people["failure"] != ""].iterrows():
        failure = row["failure"].rstrip(".")
        yield Note("failure", f"{_person(row)} could not be searched: {failure}")
    unknown = people[leaves_unknown(people)]
    if len(unknown):
        who = listed([_person(row) for _, row in unknown.iterrows()])
        text = f"something without a name is missing in {who}: see searches_[subject, condition]"
        yield Note("unknown", text)
    added = found.members_[found.members_["has"] & ~found.members_["named"]]
    for effect, table in added.groupby("effect", sort=False):
        who = listed([_person(row) for _, row in table.iterrows()])
        yield Note(
            "added",
            f"{title_of(str(effect))} in {who} is named by the evidence of the group; the runs of "
            "the person alone do not name it",
        )
    for _, row in found.identified_.outlying.iterrows():
        yield Note("outlying", f"{row['subject']} looks wrong: {str(row['reason']).rstrip('.')}")


def _person(row: Any) -> str:
    where = "" if row["condition"] == ALL else f" in {row['condition']}"
    return f"{row['subject']}{where}"
