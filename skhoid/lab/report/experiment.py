"""The page of an experiment with people: recordings, effects of the group, who differs."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.validation import check_is_fitted

from ...effects import title_of, titles_of
from ...recordings import ExperimentCheck
from ...runs import read_layout
from ...text import DASH, VAF_RULE, Note, Step, TextTable, as_sentence, counted, p_number, tell
from ..experiment.factors import Factors
from ..experiment.group import (
    GroupEffectSearch,
    contrast_lines,
    group_lines,
    headline,
    leaves_unknown,
    notes,
    single_lines,
    tell_limit,
)
from ..experiment.groups import ALL, Group, read_groups
from ..experiment.mending import Mended
from ..experiment.mixed import tell_changes
from ..experiment.people import PeopleResult
from .experiment_parts import parameters_section, people_section, people_text, sure_text
from .page import Page, advise, provenance
from .plots import ExperimentGallery

KEY = ["subject", "condition"]
MOST = 60  # lines in a list
SINGLE = 3  # effects of single people
SECTIONS = {
    "data": "Recordings",
    "effects": "Effects, and how many people have them",
    "parameters": "Parameters",
    "people": "People",
    "differs": "Who differs",
    "each": "Each person",
    "next": "What to do next",
    "made": "How this was made",
}
FEW = 6  # people, below which a group tells little


@dataclass(frozen=True)
class Experiment:
    """What a page is made of; ``each_run`` says whether parameters of runs were asked for."""

    group: GroupEffectSearch | None
    people: PeopleResult
    own_people: bool
    mended: Mended | None = None

    @cached_property
    def subjects(self) -> list[Any]:
        return list(dict.fromkeys(self.people.runs["subject"]))

    @cached_property
    def conditions(self) -> list[Any]:
        return list(dict.fromkeys(self.people.runs["condition"]))

    @cached_property
    def outlying(self) -> pd.DataFrame:
        """What looks wrong, by the identification and by the search, each once."""
        tables = [self.people.outlying]
        if self.group is not None and self.own_people:
            tables.append(self.group.identified_.outlying)
        return pd.concat(tables, ignore_index=True).drop_duplicates([*KEY, "run", "kind"])

    @property
    def changed(self) -> list[str]:
        """What was changed in the recordings, in sentences."""
        return [] if self.mended is None else self.mended.sentences

    @cached_property
    def failures(self) -> pd.DataFrame:
        tables = [self.people.failures]
        if self.group is not None and self.own_people:
            tables.append(self.group.identified_.failures)
        return pd.concat(tables, ignore_index=True).drop_duplicates([*KEY, "run", "failure"])


def experiment_content(
    given: Experiment,
    X: pd.DataFrame | None,
    y: Any,
    *,
    check: ExperimentCheck | None,
    reference: Any,
    factors: Factors | None,
    source: str | None,
    made_with: dict[str, str] | None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Everything the template shows, and the mixed models by parameter."""
    groups = _groups(given, X, y)
    names = [*given.subjects, *given.conditions, *given.people.runs["run"].unique()]
    gallery = ExperimentGallery(map(str, names))
    anchors = {who: f"person-{number}" for number, who in enumerate(given.subjects, 1)}
    say = partial(tell, typed="command" in (made_with or {}))
    parameters, statistics = parameters_section(given, reference, factors, gallery)
    content = {
        "in_short": _in_short(given),
        "sections": {k: title for k, title in SECTIONS.items() if k != "effects" or given.group},
        "vaf_rule": VAF_RULE,
        "verdict": _verdict(given, tell_changes(statistics.values(), given.people.meanings), check),
        "facts": list(_facts(given)),
        "source": source,
        "data": _data(given, groups, check, anchors),
        "effects": None if given.group is None else _effects(given.group, gallery),
        "parameters": parameters,
        "people": people_section(given, groups, anchors, gallery),
        "differs": _differs(given, anchors),
        "next_steps": list(_next_steps(given, check, say)),
        "made": _made(given, X, y, made_with),
    }
    return content, statistics


def _groups(given: Experiment, X: pd.DataFrame | None, y: Any) -> dict[tuple[Any, Any], Group]:
    """The recordings of each person and condition, checked against the result."""
    if X is None:
        return {}
    known = set(zip(*(given.people.runs[name] for name in KEY), strict=True))
    groups = {(group.subject, group.condition): group for group in read_groups(X, y)}
    missing = known - groups.keys()
    if missing:
        who = _where(*sorted(missing, key=str)[0])
        raise ValueError(
            f"X has no runs of {who}, whom the result has: give the X and y that it was found in."
        )
    return groups


def _where(subject: Any, condition: Any) -> str:
    """A person and, where there are several, the condition."""
    where = "" if condition == ALL else f" in {condition}"
    return f"{'everybody' if subject == ALL else subject}{where}"


def _in_short(given: Experiment) -> str:
    if given.group is not None:
        return headline(given.group).rstrip(".")
    vaf = given.people.groups["vaf"].dropna()
    spread = f", VAF {vaf.min():.0f} to {vaf.max():.0f} %" if len(vaf) else ""
    return f"{people_text(len(given.subjects))}{spread}"


def _counts(given: Experiment) -> str:
    conditions = [c for c in given.conditions if c != ALL]
    several = f" in {counted(len(conditions), 'condition')}" if conditions else ""
    return f"{people_text(len(given.subjects))}{several}"


def _verdict(
    given: Experiment, changes: list[str], check: ExperimentCheck | None
) -> dict[str, Any]:
    """What conditions change, then what the group has, and who is wrong."""
    group = given.group
    people = given.people.groups.drop_duplicates(KEY)
    vaf = people["vaf"].dropna()
    said = [_upper(text) for text in changes]
    if group is None:
        text = f"{_counts(given)}, identified by {_name_class(given.people.estimator)}"
        if len(vaf):
            text += f": VAF {vaf.min():.0f} to {vaf.max():.0f} %, median {vaf.median():.0f} %"
        said.append(f"{text}.")
        kind, rest = "none", ["Which effects the models miss has not been asked."]
    else:
        single = list(single_lines(group))
        kind = "found" if group.group_effects_ else "none" if single else "nothing"
        said.append(headline(group))
        rest = [_upper(line) for line in (*contrast_lines(group), *group_lines(group))]
        rest += map(_upper, single[:SINGLE])
        if len(single) > SINGLE:
            rest.append(f"And {len(single) - SINGLE} more effects of single people.")
        unknown = sum(leaves_unknown(group.people_))
        if unknown:
            rest.append(
                f"Something without a name is still missing in {unknown} of {len(group.people_)} "
                "searches."
            )
    if not changes and len([c for c in given.conditions if c != ALL]) > 1:
        rest.append("No parameter differs between conditions beyond chance.")
    sentences = [*said[1:], *rest, *_odd(given), *_to_check(given, check)]
    return {"kind": "found" if changes else kind, "headline": said[0], "sentences": sentences}


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _name_class(estimator: str) -> str:
    return estimator.partition("(")[0]


def _odd(given: Experiment) -> Iterator[str]:
    """Whether anybody looks wrong, or could not be fitted."""
    yield from map(as_sentence, given.changed)
    if given.mended is not None:
        yield from given.mended.other_version
    who = list(dict.fromkeys(given.outlying["subject"]))
    if who:
        verb, count = ("looks", "counts") if len(who) == 1 else ("look", "count")
        yield f"{_some(who)} {verb} wrong, or a run does, and {count} all the same."
    failed = list(dict.fromkeys(given.failures["subject"]))
    if failed:
        yield f"Not all could be fitted: {_some(failed)}."


def _to_check(given: Experiment, check: ExperimentCheck | None) -> Iterator[str]:
    """Findings in the recordings of people about whom nothing was done."""
    done = set() if given.mended is None else set(given.mended.changes["subject"].map(str))
    names = [
        f"{_some(one.subjects) or 'everybody'} ({one.name})"
        for one in ([] if check is None else check.found)
        if not done & set(map(str, one.subjects))
    ]
    if names:
        yield f"To check in the recordings: {_some(list(dict.fromkeys(names)))}."


def _some(names: list[Any]) -> str:
    shown = ", ".join(map(str, names[:6]))
    return shown + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _facts(given: Experiment) -> Iterator[tuple[str, str, str]]:
    """Figures at the top: value, what it is, and a remark."""
    conditions = [c for c in given.conditions if c != ALL]
    runs = given.people.runs
    each = runs.groupby(KEY, sort=False).size()
    yield str(len(given.subjects)), "people", counted(max(len(conditions), 1), "condition")
    few, many = int(each.min()), int(each.max())
    spread = f"{few}" if few == many else f"{few} to {many}"
    each_of = "of each, in each condition" if len(conditions) > 1 else "of each"
    yield str(len(runs)), "runs", f"{spread} {each_of}"
    people = given.people.groups.drop_duplicates(KEY)
    vaf, top = people["vaf"].dropna(), people["ceiling"].dropna()
    if len(vaf):
        remark = f"of the free run; {vaf.min():.0f} to {vaf.max():.0f} %, on the rows of the fit"
        yield f"{vaf.median():.0f} %", "median VAF", remark
    if len(top):
        known = "" if len(top) == len(people) else f", known of {len(top)} of {len(people)} fits"
        remark = f"what a model could reach, judged by what these leave{known}"
        yield f"at least {top.median():.0f} %", "median noise ceiling", remark
    group = given.group
    for name in [] if group is None else group.group_effects_[:3]:
        rows = group.prevalence_[group.prevalence_["effect"] == name]  # type: ignore[union-attr]
        own = rows[(rows["condition"] != ALL) & rows["group"]]
        row = (own if len(own) else rows).sort_values("p_group").iloc[-1]
        remark = f"{100 * row['low']:.0f} to {100 * row['high']:.0f} %"
        if row["condition"] != ALL and len(set(map(str, own["with_it"]))) > 1:
            remark += f", in {row['condition']}"
        yield f"{100 * row['share']:.0f} %", f"of people have {title_of(name)}", remark
    odd = given.outlying["subject"].nunique()
    yield str(odd), "look wrong" if odd != 1 else "looks wrong", "people, or runs of theirs"


def _data(
    given: Experiment,
    groups: dict[tuple[Any, Any], Group],
    check: ExperimentCheck | None,
    anchors: dict[Any, str],
) -> dict[str, Any]:
    """People by conditions: how many runs and rows, and what looks wrong."""
    runs = given.people.runs
    each = runs.groupby(KEY, sort=False)["n_rows"]
    sizes = {key: (len(own), int(own.sum())) for key, own in each}
    rows = []
    for who in given.subjects:
        cells = []
        for condition in given.conditions:
            n, n_rows = sizes.get((who, condition), (0, 0))
            cells.append(f"{counted(n, 'run')}, {n_rows:,} rows" if n else "no runs")
        wrong = [*_checked(check, who), *_wrong(given, who)]
        rows.append([str(who), *cells, "; ".join(wrong) or DASH])
    names = ["runs" if c == ALL else str(c) for c in given.conditions]
    header = ["person", *names, "what looks wrong"]
    people = TextTable("People and conditions", header, rows, left=[header[0], header[-1]])
    sentence = f"{_counts(given)}, {counted(len(runs), 'run')}, {int(runs['n_rows'].sum()):,} rows"
    first = next(iter(groups.values()), None)
    if first is not None:
        with contextlib.suppress(ValueError):  # of a clock that no run has
            sentence += f" at {1 / read_layout(first.run(0)[0]).dt:.5g} Hz"
    findings = [] if check is None else check.findings.to_dict("records")
    return {
        "sentence": sentence,
        "people": people,
        "links": [anchors[who] for who in given.subjects],
        "checked": check is not None,
        "findings": [
            {
                "title": f"{_who(row)}: {row['title']}.",
                "evidence": row["evidence"],
                "meaning": "",
                "explained": "",
                "next_step": row["next_step"],
            }
            for row in findings[:MOST]
        ],
        "notes": [*given.people.notes][:MOST],
        "mended": given.mended.document().html() if given.changed else "",  # type: ignore[union-attr]
    }


def _checked(check: ExperimentCheck | None, who: Any) -> list[str]:
    """What the check of the recordings calls wrong, and in which conditions, if not in all."""
    if check is None:
        return []
    own = check.table[check.table["subject"] == who]
    return [
        str(wrong)
        if len(rows) == len(own)
        else f"{', '.join(map(str, rows['condition']))}: {wrong}"
        for wrong, rows in own[own["wrong"] != ""].groupby("wrong", sort=False)
    ]


def _wrong(given: Experiment, who: Any) -> list[str]:
    """What looks wrong about somebody, or could not be fitted."""
    odd = given.outlying[given.outlying["subject"] == who].to_dict("records")
    failed = given.failures[given.failures["subject"] == who].to_dict("records")
    return [
        *(f"{_of(row)}{row['reason']}" for row in odd),
        *(f"{_of(row)}no fit: {row['failure']}" for row in failed),
    ]


def _who(row: dict[str, Any]) -> str:
    runs = "" if str(row["runs"]) == ALL else f", runs {row['runs']}"
    return _where(row["subject"], row["condition"]) + runs


def _of(row: dict[str, Any]) -> str:
    """Condition and run of something that looks wrong."""
    parts = [str(row["condition"])] * (row["condition"] != ALL)
    parts += [f"run {row['run']}"] * (row["run"] != ALL)
    return f"{', '.join(parts)}: " if parts else ""


def _effects(group: GroupEffectSearch, gallery: ExperimentGallery) -> dict[str, Any]:
    whole = group.prevalence_
    had = set(whole.loc[whole["group"] | (whole["n_with"] > 0), "effect"])
    table = whole[whole["effect"].isin(had)]
    rows = [
        [
            _upper(title_of(row["effect"])),
            "all conditions" if row["condition"] == ALL else str(row["condition"]),
            "yes" if row["group"] else "no",
            f"{row['n_with']} of {row['n_people']}",
            f"{100 * row['share']:.0f}",
            f"{100 * row['low']:.0f} to {100 * row['high']:.0f}",
            f"{100 * row['p_group']:.1f}",
            _told(row["with_it"], row["without"]),
            _told(row["without"], row["with_it"])
            + tell_limit(
                group,
                row["effect"],
                row["without"],
                None if row["condition"] == ALL else [row["condition"]],
            ),
        ]
        for row in table.to_dict("records")
    ]
    left = ["effect", "condition", "of the group", "shown in", "not shown in"]
    numbers = ["people", "prevalence, %", "95 % interval", "probability, %"]
    nobodys = [name for name in dict.fromkeys(whole["effect"]) if name not in had]
    contrasts = [
        [
            _upper(title_of(row["effect"])),
            f"{row['condition']} and {row['other']}",
            f"{row['n_with']} and {row['n_other']} of {row['n_people']}",
            f"{row['only_here']} and {row['only_there']}",
            p_number(row["p"]),
            p_number(row["p_adjusted"]),
        ]
        for row in group.contrasts_.to_dict("records")
        if row["effect"] in had
    ]
    of_contrasts = ["effect", "conditions", "people with it", "in one only", "p", "p, Holm"]
    tried = group.search.effects
    return {
        "tried": "the whole catalogue" if tried == "all" else titles_of(_ids(tried)),
        "least": f"{100 * float(group.least_prevalence):g}",
        "picture": gallery.group_effects(group, table) if len(table) else None,
        "nobodys": titles_of(nobodys) if nobodys else "",
        "table": TextTable(
            "Effects by prevalence; those of the group are marked",
            [*left[:3], *numbers, *left[3:]],
            rows,
            left=left,
        ),
        "marked": list(map(bool, table["group"])),
        "several": len(set(table["condition"])) > 1,
        "contrasts": TextTable("", of_contrasts, contrasts, left=of_contrasts[:2]),
        "differ": list(contrast_lines(group)),
    }


def _told(names: list[Any], others: list[Any]) -> str:
    """Names in a table, short where they are most of the people."""
    if not names or not others:
        return "everybody" if names else "nobody"
    return ", ".join(map(str, names)) if len(names) <= max(len(others), FEW) else "all others"


def _ids(effects: Any) -> list[str]:
    return [one if isinstance(one, str) else one.name for one in effects]


def _differs(given: Experiment, anchors: dict[Any, str]) -> list[dict[str, Any]]:
    """Who differs from the others, with the reasons."""
    found = {who: [as_sentence(text) for text in _wrong(given, who)] for who in given.subjects}
    if given.group is not None:
        for who, sentence in _unlike_the_group(given.group):
            found[who].append(sentence)
    return [
        {"name": str(who), "anchor": anchors[who], "reasons": reasons}
        for who, reasons in found.items()
        if reasons
    ]


def _unlike_the_group(group: GroupEffectSearch) -> Iterator[tuple[Any, str]]:
    """Who lacks an effect of the group, or has one that the group has not."""
    members, table = group.members_, group.prevalence_
    where_of = {name: set(t["condition"]) for name, t in table[table["group"]].groupby("effect")}
    for (who, effect), rows in members.groupby(["subject", "effect"], sort=False):
        title = title_of(str(effect))
        of_group = effect in group.group_effects_
        its = where_of.get(effect, set()) - {ALL}
        if of_group and its:  # elsewhere nobody is expected to have it
            rows = rows[rows["condition"].isin(its)]
        unlike = rows[~rows["has"]] if of_group else rows[rows["has"]]
        if unlike.empty:
            continue
        where = "" if len(unlike) == len(rows) else f" in {_some(list(unlike['condition']))}"
        ends = dict.fromkeys(sure_text(edge) for edge in np.quantile(unlike["probability"], [0, 1]))
        sure = " to ".join(ends)
        if of_group:
            limit = tell_limit(group, str(effect), [who], list(unlike["condition"]))
            said = f"{_upper(title)}, which the group has, is not shown{where}{limit}"
        else:
            said = f"{_upper(title)}, which is not the group's, is shown{where}"
        yield who, f"{said}; probability of having it: {sure}."


def _next_steps(
    given: Experiment, check: ExperimentCheck | None, say: Callable[[Note | str], str]
) -> Iterator[dict[str, str]]:
    """What to do next: what, and why."""
    if check is None:
        yield advise(
            "Check the recordings",
            "skhoid.check_experiment(X, y) compares channels, units, clocks and runs of people.",
        )
    n = len(given.subjects)
    if n < FEW:
        yield advise(
            f"Do not take {people_text(n)} for people in general",
            "Means, intervals and prevalences of so few are wide, and their assumptions cannot be "
            "checked. Single people can be told about; the group hardly.",
        )
    if len(given.outlying):
        yield advise(
            "Look at who and what looks wrong, before believing the means",
            "They count in all that is told. Look at the person's part of this page and at the "
            + say(
                Step(
                    'recording; outlying="leave_out" in skhoid.lab.experiment.mixed_model shows '
                    "what depends on it.",
                    "recording; --leave-out leaves them out.",
                )
            ),
        )
    if given.group is None:
        yield advise(
            "Ask what the models miss",
            say(
                Step(
                    "skhoid.GroupEffectSearch(EffectSearchCV(OperatorRegressor())).fit(X, y) "
                    "searches in everybody, and says what the group shares.",
                    "Without --effects none the command searches in everybody, and says what the "
                    "group shares.",
                )
            ),
        )
    else:
        for note in notes(given.group):
            if note.kind != "outlying":  # which is said above
                yield advise("Note", as_sentence(note.text))
    yield advise(
        "Go on in other programs",
        say(
            Step(
                "skhoid.lab.experiment.write_long writes the rows, and an R script for lme4; "
                "write_wide a table for SPSS or JASP.",
                "--tables FOLDER writes the rows, an R script for lme4, and a table for SPSS or "
                "JASP.",
            )
        ),
    )
    yield advise(
        "Look at one person in full",
        say(
            Step(
                "skhoid.report(search, X_of_person, y_of_person) makes a page of one person's "
                "model, with comparison, ranking and error path.",
                "skhoid report FILES, with the files of one person, makes a page of their model, "
                "with comparison, ranking and error path.",
            )
        ),
    )


def _made(
    given: Experiment, X: pd.DataFrame | None, y: Any, made_with: dict[str, str] | None
) -> dict[str, str]:
    stated = dict(made_with or {})
    if given.group is None or given.own_people:
        stated |= {"Identified by": given.people.estimator}
    data = (X, y) if X is not None else (pd.DataFrame(), pd.DataFrame())
    made = provenance(given.group, *data, stated)
    if X is None:
        del made["Data (SHA-256 of X, y)"]
    if given.group is None:
        del made["Settings of NoneType"]
    return made


class ExperimentReport(Page):
    """A report on an experiment: who was recorded, what the group has, parameters, each person.

    Make it with :func:`report_experiment`, or with :func:`skhoid.report`. In a notebook it shows
    itself.

    Parameters
    ----------
    title : str
        Title of the page.
    content : dict
        What its template shows.
    statistics : dict
        ``MixedModelResult`` by parameter; only those that could be made.

    Attributes
    ----------
    html : str
        The whole page: one file with its plots inside, which needs no network.

    Examples
    --------
    >>> from skhoid import ARXRegressor, identify_people, report, simulate_experiment
    >>> X, y = simulate_experiment(2, "C1", runs=1, duration=20.48, random_state=0)
    >>> people = identify_people(ARXRegressor(nk=29), X, y, each_run=False, ceiling=False)
    >>> report(people, title="Two people")
    <ExperimentReport 'Two people': 2 people, VAF ... %>
    """

    template = "experiment"

    def __init__(self, title: str, content: dict[str, Any], statistics: dict[str, Any]):
        super().__init__(title, content)
        self.statistics = statistics


def report_experiment(
    experiment: GroupEffectSearch | PeopleResult,
    X: pd.DataFrame | None = None,
    y: Any = None,
    *,
    people: PeopleResult | None = None,
    check: ExperimentCheck | None = None,
    mended: Mended | None = None,
    reference: Any = None,
    factors: Factors | None = None,
    title: str | None = None,
    source: str | None = None,
    made_with: dict[str, str] | None = None,
) -> ExperimentReport:
    """Report on an experiment with people: one HTML page from the recordings to each person.

    Parameters
    ----------
    experiment : GroupEffectSearch or PeopleResult
        What was found: by a fitted search in the group, or by :func:`skhoid.identify_people`.
    X : DataFrame or None, default=None
        The channels that it was found in. Without them there are no pictures of measured and
        simulated output where only people were identified, and no rate and fingerprint of the data.
    y : Series or None, default=None
        The control output.
    people : PeopleResult or None, default=None
        Parameters of each run, beside a search in the group, which fits all runs together. They
        are then compared between conditions in place of those of the search.
    check : ExperimentCheck or None, default=None
        What :func:`skhoid.check_experiment` found.
    mended : Mended or None, default=None
        What :func:`skhoid.lab.experiment.mend_recordings` changed in the recordings before.
    reference : label or None, default=None
        Condition against which the others are compared; None compares all pairs.
    factors : dict, sequence of str or None, default=None
        What conditions are combinations of, as in :func:`skhoid.lab.experiment.mixed_model`.
    title : str or None, default=None
        Title of the page.
    source : str or None, default=None
        Where the data are from, in a sentence.
    made_with : dict of str or None, default=None
        More lines for the section "How this was made": a seed, or the "command"; with one, what to
        do next is told in commands.

    Returns
    -------
    report : ExperimentReport
        ``save(path)`` writes the file, ``open_in_browser()`` shows it; notebooks show it too.

    Raises
    ------
    TypeError
        If ``experiment`` is neither of the two.
    NotFittedError
        If the search is not fitted.
    ValueError
        If ``X`` has no runs of somebody whom the result has, there is no such ``reference``, or X
        is given without y.

    Examples
    --------
    >>> from skhoid import ARXRegressor, identify_people, simulate_experiment
    >>> from skhoid.lab.report import report_experiment
    >>> X, y = simulate_experiment(2, "C1", runs=1, duration=20.48, random_state=0)
    >>> people = identify_people(ARXRegressor(nk=29), X, y, each_run=False, ceiling=False)
    >>> page = report_experiment(people, X, y)
    >>> page.save("experiment.html")  # doctest: +SKIP
    """
    if isinstance(experiment, GroupEffectSearch):
        check_is_fitted(experiment, "prevalence_")
        own = people and people.of_members(experiment.members_)
        given = Experiment(experiment, own or experiment.identified_, people is not None, mended)
    elif isinstance(experiment, PeopleResult):
        given = Experiment(None, experiment, True, mended)
    else:
        raise TypeError(
            "report_experiment takes a fitted GroupEffectSearch, or the PeopleResult of "
            f"identify_people; got {type(experiment).__name__}."
        )
    if (X is None) != (y is None):
        raise ValueError("Give X and y together, or neither of them.")
    if reference is not None and reference not in given.conditions:
        raise ValueError(
            f"reference is one of {', '.join(map(str, given.conditions))}; got {reference!r}."
        )
    content, statistics = experiment_content(
        given,
        X,
        y,
        check=check,
        reference=reference,
        factors=factors,
        source=source,
        made_with=made_with,
    )
    return ExperimentReport(title or "An experiment with people", content, statistics)
