"""Sphinx extension: the catalogue's grid, and a card for each effect, made from the effects.

``effect-grid`` shows all effects of a place, each a link to its page; ``effect-card`` opens that
page, which autosummary makes by ``_templates/autosummary/effect.rst`` of the list ``cards/all``.
To change what a card says, change the effect; to change how, ``_templates/effect_card.rst``.
"""

import re
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd
from docutils import nodes
from effect_pictures import make_key, picture
from jinja2 import Environment, FileSystemLoader
from sphinx.util.docutils import SphinxDirective

from skhoid.effects import Dimension, Effect, title_of
from skhoid.effects.catalogue import BY_NAME, CLASSES, EXPERIMENTS
from skhoid.effects.composition import PLACES
from skhoid.search.likeness import ANY_EXPERIMENT

DOCS = Path(__file__).parent
SYMBOLS = {"K_e": "K_e", "K_edot": r"K_{\dot e}", "t_M": "t_M", "T_I": "T_I"} | {
    f"{name}_nm": rf"\{name}_{{nm}}" for name in ("omega", "zeta")
}
UNITS = {"u": "[u]", "e": "[e]"}
TEMPLATES = Environment(
    loader=FileSystemLoader(DOCS / "_templates"), trim_blocks=True, lstrip_blocks=True
)


def heading(name: str) -> str:
    """The title of an effect at the head of a page."""
    title = title_of(name)
    return title[0].upper() + title[1:]


def page_of(effect: type[Effect]) -> str:
    """The document of an effect's card."""
    return f"cards/skhoid.effects.{effect.__name__}"


def is_for(effect: type[Effect]) -> str:
    """Whom a search tries the effect for."""
    return "machines only" if effect.domains == ("machine",) else "people and machines"


def examples_of(name: str) -> list[Effect]:
    """The effect with numbers, one object for each form."""
    return [BY_NAME[name](**arguments) for arguments in BY_NAME[name].examples]


def form_of(example: Effect) -> str:
    """What tells an example from the others of its effect: its form, or what triggers it."""
    for argument in ("form", "trigger", "side"):
        if len(example.choices.get(argument, ())) > 1:
            return str(getattr(example, argument))
    return ""


def confused_with(name: str) -> list[tuple[str, str]]:
    """Effects that are easily taken for this one, and what tells them apart."""
    return [
        (other, told)
        for pair, told in EXPERIMENTS.items()
        if name in pair
        for other in pair - {name}
    ]


def in_the_trial(name: str) -> str:
    """How often the blind trial named the effect where it was hidden; "" where it never was."""
    counts = pd.read_csv(DOCS / "_static" / "confusion.csv", index_col="hidden")
    if name not in counts.index:
        return ""
    row = counts.loc[name]
    others = [
        f"{'“unknown”' if n == 'unknown' else title_of(n)} in {count}"
        for n, count in row.drop([name, "none"]).items()
        if count
    ]
    nothing = [f"nothing in {row['none']}"] if row["none"] else []
    instead = f"; {', '.join(others + nothing)}" if others or nothing else ""
    return f"named first in {row[name]} of {row.sum()} cases{instead}"


def collect_parameters(examples: list[Effect]) -> list[tuple[str, str, str, str]]:
    """Name, unit and meaning of every number, with the forms that have it where not all do."""
    forms: dict[tuple[str, str, str], list[str]] = {}
    for example in examples:
        for p in example.parameters:
            unit = "none" if p.dimension == Dimension() else p.dimension.label(UNITS)
            meaning = re.sub(r"\w+", lambda word: _typeset(word[0]), p.meaning)
            forms.setdefault((p.name, unit, meaning), []).append(form_of(example))
    return [
        (*row, "" if len(having) == len(examples) else ", ".join(having))
        for row, having in sorted(forms.items(), key=lambda item: _first(item[0][0], forms))
    ]


def _typeset(word: str) -> str:
    return f":math:`{SYMBOLS[word]}`" if word in SYMBOLS else word


def _in_html(word: re.Match[str]) -> str:
    """A symbol as MathJax finds it in the page itself."""
    symbol = SYMBOLS.get(word[0])
    return (
        f'<span class="math notranslate nohighlight">\\({symbol}\\)</span>' if symbol else word[0]
    )


def _first(name: str, rows: dict[tuple[str, str, str], list[str]]) -> int:
    """Where a name is listed first, so that its rows stand together."""
    return [row[0] for row in rows].index(name)


def signals_of(parameters: list[tuple[str, str, str, str]], answered: str) -> str:
    """What the brackets in the units of parameters stand for."""
    units = " ".join(unit for _, unit, _, _ in parameters)
    known = {"[e]": answered, "[u]": "the output", "[x]": "x", "[f_t]": "the target"}
    named = [f"{unit} of {words}" for unit, words in known.items() if unit in units]
    other = sorted(set(re.findall(r"\[\w+\]", units)) - set(known))
    named += [f"{unit} of the channel {unit[1:-1]}" for unit in other]
    return f"Units: {', '.join(named)}." if named else ""


def card(name: str, uri: Any) -> str:
    """The card of an effect as reStructuredText; ``uri`` gives the address of a document."""
    effect = BY_NAME[name]
    examples = examples_of(name)
    own = effect()
    place = own.place
    parameters = collect_parameters(examples)
    model = "OperatorRegressor(" if "human" in effect.domains else "SimulatedARX(2, 2, "
    return TEMPLATES.get_template("effect_card.rst").render(
        effect=effect,
        place=place,
        place_number=PLACES_IN_ORDER.index(place) + 1,
        catalogue=uri("effects"),
        also_at=" or ".join(f"the {at}" for at in effect.choices.get("at", ())[1:]),
        is_for=is_for(effect),
        pictures=[(form_of(example), picture(example)) for example in examples],
        key=[(kind, re.sub(r"\w+", _in_html, words)) for kind, words in make_key(examples[0])],
        several=len(examples) > 1,
        parameters=parameters,
        signals=signals_of(parameters, "the error" if "human" in effect.domains else "the input"),
        confused=[
            (heading(other), BY_NAME[other].__name__, told) for other, told in confused_with(name)
        ],
        trial=in_the_trial(name),
        trial_page=uri("trust-a-name") + "#how-often-the-name-is-right",
        estimate=f'{model}effects="{name}").fit(X, y)',
        given=re.sub(r"\s+", " ", repr(examples[0])).replace("'", '"'),
    )


def pairs() -> str:
    """Effects that are taken for each other, and what tells them apart, as reStructuredText."""
    rows = [
        (" and ".join(_linked(name) for name in sorted(pair)), told)
        for pair, told in EXPERIMENTS.items()
    ]
    rows.append(("others", ANY_EXPERIMENT))
    lines = [".. list-table::", "   :header-rows: 1", "", "   * - effects", "     - told apart by"]
    for named, told in rows:
        lines += [f"   * - {named}", f"     - {told}"]
    return "\n".join(lines)


def _linked(name: str) -> str:
    return f":doc:`{title_of(name)} </{page_of(BY_NAME[name])}>`"


# The numbers of the map: the way of a signal, and what is inside a machine last.
PLACES_IN_ORDER = (*(p for p in PLACES if p != "inside"), "inside")


def grid(place: str, uri: Any) -> str:
    """All effects of a place as HTML: picture, title, id and a sentence."""
    items = []
    for effect in CLASSES:
        if effect().place != place:
            continue
        drawn = picture(examples_of(effect.name)[0], labels=False)
        only = "" if "human" in effect.domains else f' <span class="for">{is_for(effect)}</span>'
        items.append(
            f'<li><a href="{uri(page_of(effect))}">{drawn}'
            f"<strong>{escape(heading(effect.name))}</strong>"
            f"<code>{effect.name}</code>{only}<span>{escape(effect.physics)}</span></a></li>"
        )
    return f'<ul class="effect-grid">{"".join(items)}</ul>'


class _Directive(SphinxDirective):
    optional_arguments = 1

    def uri(self, document: str) -> str:
        """The address of a document, seen from this page."""
        return self.env.app.builder.get_relative_uri(self.env.docname, document)

    def run(self) -> list[nodes.Node]:
        for module in ("effect_cards", "effect_pictures"):
            self.env.note_dependency(str(DOCS / f"{module}.py"))
        return self.made(" ".join(self.arguments))

    def made(self, argument: str) -> list[nodes.Node]:
        raise NotImplementedError


class EffectGrid(_Directive):
    """``effect-grid:: place``."""

    def made(self, argument: str) -> list[nodes.Node]:
        return [nodes.raw("", grid(argument, self.uri), format="html")]


class EffectCard(_Directive):
    """``effect-card:: Class``."""

    def made(self, argument: str) -> list[nodes.Node]:
        (name,) = (c.name for c in CLASSES if c.__name__ == argument)
        return self.parse_text_to_nodes(card(name, self.uri))


class EffectPairs(_Directive):
    """``effect-pairs::``."""

    def made(self, argument: str) -> list[nodes.Node]:
        return self.parse_text_to_nodes(pairs())


def list_effects(app: Any, config: Any) -> None:
    """Write the page of all classes, of which autosummary makes the cards; title these."""
    lines = ["All effects by class", "=" * 20, ""]
    lines += [".. currentmodule:: skhoid.effects", "", ".. autosummary::", "   :toctree: ."]
    lines += ["   :template: autosummary/effect.rst", "   :nosignatures:", ""]
    in_order = sorted(CLASSES, key=lambda c: PLACES_IN_ORDER.index(c().place))
    lines += [f"   {c.__name__}" for c in in_order]
    page = DOCS / "cards" / "all.rst"
    page.parent.mkdir(exist_ok=True)
    text = "\n".join([*lines, ""])
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
    config.autosummary_context = {
        **config.autosummary_context,
        "effect_titles": {c.__name__: heading(c.name) for c in CLASSES},
    }


def setup(app: Any) -> dict[str, Any]:
    app.add_directive("effect-grid", EffectGrid)
    app.add_directive("effect-card", EffectCard)
    app.add_directive("effect-pairs", EffectPairs)
    app.connect("config-inited", list_effects)
    app.add_css_file("effects.css")
    return {"parallel_read_safe": True, "parallel_write_safe": True}
