"""The one printer: documents as text, HTML and JSON; and the words that all of them share.

A result is told as a :class:`Document`, once; how it looks in a console, a notebook, a report or
JSON is decided here, and so is how a VAF, a p-value, a gap or an estimate is written.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

WIDTH = 88  # columns
LABEL = 16  # columns of a label in the header
DASH = "-"
VAF_RULE = (
    "VAF compares with zero, not with the mean, and is not clipped, unless it says otherwise."
)
STYLE = """<style>
.skhoid-summary {color: inherit; font-size: 0.9em; margin-top: 0.5em; overflow-x: auto}
.skhoid-summary p {margin: 0.4em 0}
.skhoid-summary table {border-collapse: collapse; color: inherit; margin: 0.4em 0}
.skhoid-summary caption {font-weight: bold; text-align: left}
.skhoid-summary th, .skhoid-summary td {background: none; border: 0; color: inherit;
  border-bottom: 1px solid color-mix(in srgb, currentColor 25%, transparent);
  font-variant-numeric: tabular-nums; padding: 0.2em 0.7em; text-align: right}
.skhoid-summary .left {text-align: left}
pre.skhoid-summary {background: none; line-height: 1.4; margin: 0.5em 0; padding: 0;
  white-space: pre}
</style>"""


@dataclass(frozen=True)
class TextTable:
    """Cells of text under a header; the first column names the rows.

    ``left`` are titles of columns that are aligned left; ``kind`` says what it is, such as
    ``"parameters"``, for who shows it in a way of their own.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: Sequence[str] = ("", "unit")
    kind: str = ""

    def lines(self, width: int = WIDTH) -> list[str]:
        """Lines of at most ``width`` columns, for which the widest texts take several.

        A number is never cut: a table of many numbers is wider.
        """
        columns = list(zip(self.header, *self.rows, strict=True))
        widths = [max(map(len, column)) for column in columns]
        least = [
            _find_least_width(column) if title in self.left else full
            for title, column, full in zip(self.header, columns, widths, strict=True)
        ]
        while sum(widths) + 2 * (len(widths) - 1) > width:
            spare = [a - b for a, b in zip(widths, least, strict=True)]
            if max(spare) <= 0:
                break
            widest = max((wide, i) for i, wide in enumerate(widths) if spare[i] > 0)[1]
            widths[widest] -= 1
        sides = ["<" if title in self.left else ">" for title in self.header]
        lines = []
        for row in (self.header, *self.rows):
            cells = map(_folded, row, widths)
            for parts in zip_longest(*cells, fillvalue=""):
                aligned = zip(parts, sides, widths, strict=True)
                lines.append("  ".join(f"{p:{side}{wide}}" for p, side, wide in aligned).rstrip())
        return lines

    def html(self) -> str:
        left = ["left" if title in self.left else "" for title in self.header]
        head = "".join(
            # A heading without words is none, for those who have the table read to them.
            f'<th scope="col" class="{side}">{escape(title)}</th>' if title else "<td></td>"
            for title, side in zip(self.header, left, strict=True)
        )
        body = "".join(
            f'<tr><th scope="row" class="left">{escape(row[0])}</th>'
            + "".join(
                f'<td class="{side}">{escape(cell)}</td>'
                for cell, side in zip(row[1:], left[1:], strict=True)
            )
            + "</tr>"
            for row in self.rows
        )
        return (
            f"<table><caption>{escape(self.caption)}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        )


class Summary(str):
    """A string that is shown line by line, also as the last expression of a notebook cell."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        title = next((line.strip() for line in self.splitlines() if line.strip()), "Summary")
        return (
            f'{STYLE}<pre class="skhoid-summary" role="region" tabindex="0" '
            f'aria-label="{escape(title)}">{escape(self)}</pre>'
        )


@dataclass(frozen=True)
class Note:
    """A remark beside a result: what it is about, in a word, and what it says.

    Parameters
    ----------
    kind : str
        What it is about, such as ``"settling"``: what code asks, never the text.
    text : str
        What it says, without a capital and a full stop.
    hint : str, default=""
        What one writes in Python about it.
    options : sequence of str or of (str, str), default=()
        Options of the command line that do the same, some with their values.
    """

    kind: str
    text: str
    hint: str = ""
    options: Sequence[str | tuple[str, str]] = ()

    def __str__(self) -> str:
        return self.text

    @property
    def with_hint(self) -> str:
        """The text and what one writes in Python about it."""
        return self.text + (f" ({self.hint})" if self.hint else "")


class Step(str):
    """What to do next, as one does it in Python; ``typed`` is the same at the command line."""

    typed: str

    def __new__(cls, text: str, typed: str = "") -> Step:
        step = super().__new__(cls, text)
        step.typed = typed or text
        return step


def tell(said: Note | str, typed: bool = False) -> str:
    """A note or a step as one says it to who writes Python, or to who types commands."""
    if isinstance(said, Step):
        return said.typed if typed else said
    return said.with_hint if isinstance(said, Note) and not typed else str(said)


@dataclass(frozen=True)
class Heading:
    """The title of a part."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Facts:
    """Short facts under their labels: two beside each other, or each on a line of its own."""

    facts: Mapping[str, str]
    beside: bool = True


@dataclass(frozen=True)
class Item:
    """One of a list: what it is, and under their labels what is to be said of it."""

    title: str
    parts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Items:
    """A list, numbered where its order says something."""

    items: Sequence[Item]
    numbered: bool = True


@dataclass(frozen=True)
class Notes:
    """Remarks, numbered where the text above refers to them by number."""

    notes: Sequence[Note]
    numbered: bool = False


Block = Heading | Paragraph | Facts | Items | TextTable | Notes


@dataclass(frozen=True)
class Document:
    """What a result says, neutral to where it is shown.

    Each structure of results has one function that tells it as a document; the summary, the
    notebook, the command line, the report and JSON show that.

    Parameters
    ----------
    title : str
        What the document is about.
    blocks : sequence of blocks
        Headings, paragraphs, facts, tables and notes, in order.
    ruled : bool, default=False
        Whether its text has a centred title and rules between the blocks.

    Examples
    --------
    >>> from skhoid.text import Document, Note, Notes, TextTable
    >>> table = TextTable("", ["run", "VAF"], [["1", "61.0"], ["2", "74.5"]])
    >>> notes = Notes([Note("settling", "the first 2 s are left out")])
    >>> Document("Two runs", [table, notes]).text()
    Two runs
    <BLANKLINE>
    run   VAF
      1  61.0
      2  74.5
    <BLANKLINE>
    Note: the first 2 s are left out.
    """

    title: str
    blocks: Sequence[Block]
    ruled: bool = False

    def text(self, width: int = WIDTH, say: Callable[[Note | str], str] | None = None) -> Summary:
        """Lines of at most ``width`` columns.

        ``say`` puts a note or a step into words; None takes what one writes in Python.
        """
        say = say or tell
        if not self.ruled:
            lines, after = wrapped(self.title, width=width), None
            for block in self.blocks:
                lines += [] if isinstance(after, Heading) else [""]
                lines += _lines(block, width, say)
                after = block
            return Summary("\n".join(lines))
        lines = [_shortened(self.title, width).center(width).rstrip(), "=" * width]
        for number, block in enumerate(self.blocks):
            if number:
                lines += [("=" if isinstance(block, Notes) else "-") * width]
            lines += _lines(block, width, say)
        if not any(isinstance(block, Notes) for block in self.blocks):
            lines += ["=" * width]
        return Summary("\n".join(lines))

    def html(self) -> str:
        """A part of a page, with its style."""
        body = "".join(map(_html, self.blocks))
        return (
            f'{STYLE}<div class="skhoid-summary" role="region" tabindex="0" '
            f'aria-label="{escape(self.title)}"><p><strong>{escape(self.title)}</strong></p>'
            f"{body}</div>"
        )


@dataclass(frozen=True)
class ModelSummary:
    """The summary of a fitted model: facts, tables and notes."""

    title: str
    facts: dict[str, str]
    estimates: TextTable
    notes: Sequence[str] = ()
    more: Sequence[TextTable] = field(default=())

    def document(self, above: str = "") -> Document:
        """All of it, below a line on what found the model."""
        notes = Notes([Note("", note) for note in self.notes], numbered=True)
        blocks: list[Block] = [Facts(self.facts), replace(self.estimates, caption="")]
        first: list[Block] = [Paragraph(above)] if above else []
        return Document(self.title, [*first, *blocks, *self.more, notes], ruled=True)

    def text(self) -> Summary:
        return self.document().text()

    def html(self, above: str = "") -> str:
        return self.document(above).html()


class Told:
    """A result that its ``document`` tells: as text, and in notebooks."""

    def document(self) -> Document:
        """What it says, as blocks.

        Returns
        -------
        document : Document
        """
        raise NotImplementedError

    def summary(self) -> Summary:
        """What it says, as text.

        Returns
        -------
        summary : Summary
            A string that notebooks show line by line.
        """
        return self.document().text()

    def _repr_html_(self) -> str:
        return self.document().html()


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop; a symbol of one letter stays as it is."""
    symbol = text[1:2] == " " and text[:2] != "a "
    whole = text if symbol else text[:1].upper() + text[1:]
    return whole.rstrip(".") + "." if text else ""


def rendered(module: str, template: str, **content: Any) -> str:
    """A page from a template next to a module; its content is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # for this alone

    environment = Environment(
        loader=PackageLoader(module.rpartition(".")[0], "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**content)


class Estimate(NamedTuple):
    """A parameter as text: value, standard error, ends of its interval, and unit.

    A given value has the standard error 0; one at a bound, or not determined by the data, has NaN.
    All show a dash. At a bound an interval, if there is one, ends there. A value that is not
    determined has its range for one, which is not shown.
    """

    value: str
    sd: str
    low: str
    high: str
    unit: str
    remark: str

    @classmethod
    def of(cls, row: pd.Series) -> Estimate:
        """Make it from a row with the columns value, sd, low, high and unit."""
        value, sd = float(row["value"]), float(row["sd"])
        low, high = (float(row.get(end, np.nan)) for end in ("low", "high"))
        at_bound = np.isnan(low) or value in (low, high)
        without = " (at its bound)" if at_bound else " (not determined)"
        if not (np.isfinite(sd) and sd > 0.0):
            one_sided = np.isnan(sd) and at_bound
            sd, low, high = np.nan, *((low, high) if one_sided else (np.nan, np.nan))
        unit = "" if row["unit"] == "-" else str(row["unit"])
        return cls(
            number(value, sd),
            number(sd, sd),
            number(low, sd),
            number(high, sd),
            unit,
            remark="" if np.isfinite(row["sd"]) else without,
        )

    @property
    def known(self) -> bool:
        """Whether there is a standard error."""
        return self.sd != DASH

    def __str__(self) -> str:
        """As ``0.3123 ± 0.0041 deg``."""
        error = f" ± {self.sd}" if self.known else ""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.value}{error}{unit}{self.remark}"


def estimates_table(parameters: pd.DataFrame, caption: str = "Parameters") -> TextTable:
    """Table of a frame with the columns value, sd, low, high and unit."""
    header = ["", "coef", "std err", "z", "P>|z|", "[0.025", "0.975]", "unit"]
    rows = []
    for name, row in parameters.iterrows():
        found = Estimate.of(row)
        test = [DASH, DASH]
        if found.known:
            z = float(row["value"]) / float(row["sd"])
            p = math.erfc(abs(z) / math.sqrt(2.0))
            test = [
                f"{z:.2f}" if abs(z) < 1e5 else f"{z:.3g}",
                f"{p:.3f}" if p >= 0.001 else "<0.001",
            ]
        unit = "" if "[" in found.unit else found.unit  # names of channels, where it is not known
        rows.append([str(name), found.value, found.sd, *test, found.low, found.high, unit])
    if not any(row[-1] for row in rows):
        header, rows = header[:-1], [row[:-1] for row in rows]
    return TextTable(caption, header, rows)


def number(value: float, sd: float = np.nan) -> str:
    """A number to two digits of its standard error, or to four of its own."""
    if not np.isfinite(value):
        return DASH
    if np.isfinite(sd) and sd > 0.0:
        decimals = max(1 - math.floor(math.log10(sd)), 0)
        if decimals <= 8 and abs(value) < 1e7:
            return f"{value:.{decimals}f}"
        return f"{value:.6g}"
    return f"{value:.4g}"


def ceiling_text(vaf: float) -> str:
    """A noise ceiling as texts give it: a lower bound, as what is missing may look like noise."""
    return f"{'at least ' if vaf < 99.95 else ''}{vaf:.1f} %"


def quantity(value: float, unit: str | None) -> str:
    return number(value) + (f" {unit}" if unit else "")


def vaf_name(*, centered: bool = False, clipped: bool = False) -> str:
    """Name of a VAF: the plain word compares with zero, and is not clipped (``VAF_RULE``)."""
    kinds = ["about the mean"] * centered + ["clipped at 0"] * clipped
    return f"VAF ({', '.join(kinds)})" if kinds else "VAF"


def p_text(p: float) -> str:
    """A p-value: two digits, and a bound where it is tiny."""
    return f"p {p_number(p)}" if p < 1e-6 else f"p = {p_number(p)}"


def p_number(p: float) -> str:
    """The same without the letter, for a table."""
    return "< 1e-6" if p < 1e-6 else f"{p:.2g}"


def gap_text(gap: float) -> str:
    """What is left to explain: by chance a VAF may be above the estimated ceiling."""
    if not np.isfinite(gap):
        return "not known"
    return f"{gap:.1f} VAF points" if gap >= 0.05 else "nothing"


def counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def wrapped(text: str, indent: str = "", width: int = WIDTH) -> list[str]:
    return textwrap.wrap(text, width, subsequent_indent=indent)


def _lines(block: Block, width: int, say: Callable[[Note | str], str]) -> list[str]:
    """A block as lines of text."""
    match block:
        case Heading(text) | Paragraph(text):
            return wrapped(say(text), width=width)
        case Facts(facts, beside):
            return _in_two_columns(facts, width) if beside else _labelled(facts, width)
        case Items(items, numbered):
            lines = []
            for number, (title, parts) in enumerate(((i.title, i.parts) for i in items), 1):
                mark = f"{number}. " if numbered else "- "
                lines += wrapped(mark + title, " " * len(mark), width)
                indent = " " * (len(mark) + 2)
                told = {label: say(part) for label, part in parts.items()}
                lines += [indent + line for line in _labelled(told, width - len(indent))]
            return lines
        case TextTable(caption):
            return wrapped(caption, width=width) + block.lines(width)
        case Notes(notes, numbered):
            return [
                line
                for number, note in enumerate(notes, 1)
                for line in (
                    wrapped(f"[{number}] {note}", "    ", width)
                    if numbered
                    else wrapped(f"Note: {say(note).rstrip('.')}.", "  ", width)
                )
            ]


def _html(block: Block) -> str:
    match block:
        case Heading(text):
            return f"<p><strong>{escape(text)}</strong></p>"
        case Paragraph(text):
            return f"<p>{escape(text)}</p>"
        case Facts(facts, beside):
            if beside:
                return f"<p>{escape(' · '.join(f'{k}: {v}' for k, v in facts.items()))}</p>"
            rows = "".join(
                f'<tr><th scope="row" class="left">{escape(label)}</th>'
                f'<td class="left">{escape(value)}</td></tr>'
                for label, value in facts.items()
            )
            return f"<table><tbody>{rows}</tbody></table>"
        case Items(items, numbered):
            tag = "ol" if numbered else "ul"
            listed = "".join(
                f"<li><strong>{escape(item.title)}</strong>"
                + "".join(f"<br>{escape(text)}" for text in item.parts.values())
                + "</li>"
                for item in items
            )
            return f"<{tag}>{listed}</{tag}>"
        case TextTable():
            return block.html()
        case Notes(notes):
            listed = "".join(f"<li>{escape(as_sentence(note.with_hint))}</li>" for note in notes)
            return f"<ul>{listed}</ul>" if notes else ""


def _labelled(facts: Mapping[str, str], width: int) -> list[str]:
    """Facts one below the other, each beside its label."""
    longest = max(map(len, facts), default=0) + 2
    return [
        line
        for label, value in facts.items()
        for line in wrapped(f"{label + ':':<{longest}}{value}", " " * longest, width)
    ]


def _in_two_columns(facts: Mapping[str, str], width: int) -> list[str]:
    """Facts side by side; one that is too long has a line of its own."""
    half = width // 2
    lines, left = [], ""
    for label, value in facts.items():
        cell = f"{label + ':':<{LABEL}}{value}"
        if len(cell) > half - 2:
            lines += [left] * bool(left) + wrapped(cell, " " * LABEL, width)
            left = ""
        elif left:
            lines.append(f"{left:<{half}}{cell}")
            left = ""
        else:
            left = cell
    return lines + [left] * bool(left)


def _find_least_width(texts: Sequence[str]) -> int:
    """Columns that no number of some texts is cut in."""
    words = [word for text in texts for word in text.split() if any(map(str.isdigit, word))]
    numbers = [len(word) for word in words if "[" not in word]  # units have names of channels
    return max([8, *numbers])


def _folded(cell: str, width: int) -> list[str]:
    return textwrap.wrap(cell, width, break_on_hyphens=False) or [""]


def _shortened(text: str, width: int) -> str:
    if len(text) <= width:
        return text
    return text[: width // 2] + "…" + text[len(text) - (width - width // 2 - 1) :]
