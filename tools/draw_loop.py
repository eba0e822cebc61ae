"""Draws the loop that skhoid identifies, its map of effects, and the logo.

    python tools/draw_loop.py [FOLDER]

Writes SVG files to ``docs/_static``: ``loop`` (the plain loop), ``loop-map`` (with the places where
effects act) and ``logo``, each for a light and a dark page; ``favicon.svg``; and, for the page of
the catalogue, ``loop-map-inline.svg``, whose colours follow the theme of the site and whose places
link to their groups. A test holds the files to what this script makes.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "_static"
FONT = "'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif"
BLUE, VERMILION = "#0072B2", "#D55E00"  # of the person, and of what is missing
# Places in the order of a signal's way, as PLACES of skhoid.effects.composition names them.
MARKS = ("input", "delay", "gain", "path", "command", "spring", "sum", "output", "inside")


@dataclass(frozen=True)
class Colours:
    """What a picture is drawn in."""

    ink: str
    soft: str  # of remnant, disturbance and what is said beside
    person: str
    tint: str  # of the person's frame
    paper: str  # of boxes

    @classmethod
    def of_site(cls) -> "Colours":
        """Those of the site's theme, light and dark; the second of each pair stands without it."""
        return cls(
            "var(--pst-color-text-base, #1f2328)",
            "var(--pst-color-text-muted, #59636e)",
            "var(--loop-person, #0072B2)",
            "var(--loop-tint, #eef5fa)",
            "var(--pst-color-background, #ffffff)",
        )


LIGHT = Colours("#1f2328", "#59636e", BLUE, "#eef5fa", "#ffffff")
DARK = Colours("#e6e8ea", "#a3adb8", "#56a8dc", "#17242e", "#12181d")


@dataclass
class Drawing:
    """An SVG file under way."""

    width: int
    height: int
    title: str
    words: str  # the picture in words, for who does not see it
    colours: Colours
    name: str
    inline: bool = False
    parts: list[str] = field(default_factory=list)

    def add(self, part: str) -> None:
        self.parts.append(part)

    def line(self, *points: tuple[float, float], arrow: bool = True, **kind: str) -> None:
        """A line through points, with an arrowhead at the last."""
        colour = kind.get("colour", self.colours.ink)
        dash = ' stroke-dasharray="6 5"' if "dashed" in kind else ""
        drawn = list(points)
        if arrow:
            (x0, y0), (x1, y1) = points[-2:]
            dx, dy = (x1 > x0) - (x1 < x0), (y1 > y0) - (y1 < y0)
            drawn[-1] = x1 - 8 * dx, y1 - 8 * dy
            left, right = (
                (x1 - 12 * dx - 6 * dy, y1 - 12 * dy + 6 * dx),
                (
                    x1 - 12 * dx + 6 * dy,
                    y1 - 12 * dy - 6 * dx,
                ),
            )
            head = " ".join(f"{x:g},{y:g}" for x, y in ((x1, y1), left, right))
            self.add(f'<polygon points="{head}" fill="{colour}"/>')
        path = " ".join(f"{x:g},{y:g}" for x, y in drawn)
        self.add(
            f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2.5"'
            f' stroke-linejoin="round"{dash}/>'
        )

    def text(self, x: float, y: float, words: str, size: int = 20, **kind: str) -> None:
        """Words; ``f_t`` is a symbol with an index where ``symbol`` is given."""
        colour = kind.get("colour", self.colours.ink)
        anchor = kind.get("anchor", "middle")
        bold = ' font-weight="bold"' if "bold" in kind else ""
        body = symbols(words, size) if "symbol" in kind else escape(words)
        self.add(
            f'<text x="{x:g}" y="{y:g}" font-size="{size}" text-anchor="{anchor}"{bold}'
            f' fill="{colour}">{body}</text>'
        )

    def box(self, x: float, y: float, width: float, height: float, **kind: str) -> None:
        """A rectangle by its centre."""
        fill = kind.get("fill", self.colours.paper)
        stroke = kind.get("stroke", self.colours.ink)
        self.add(
            f'<rect x="{x - width / 2:g}" y="{y - height / 2:g}" width="{width:g}"'
            f' height="{height:g}" rx="{kind.get("rx", "6")}" fill="{fill}" stroke="{stroke}"'
            ' stroke-width="2.5"/>'
        )

    def summing(self, x: float, y: float) -> None:
        """A circle in which signals are added."""
        c = self.colours
        self.add(
            f'<circle cx="{x:g}" cy="{y:g}" r="14" fill="{c.paper}" stroke="{c.ink}"'
            f' stroke-width="2.5"/><path d="M{x - 6:g} {y:g}h12M{x:g} {y - 6:g}v12"'
            f' stroke="{c.ink}" stroke-width="2"/>'
        )

    def minus(self, x: float, y: float) -> None:
        self.add(f'<path d="M{x:g} {y:g}h12" stroke="{self.colours.ink}" stroke-width="2.5"/>')

    def whole(self) -> str:
        """The file."""
        names = f'aria-labelledby="{self.name}-title {self.name}-words"'
        style = ""
        if self.inline:
            # What the theme of the site has no colour for.
            style = (
                "<style>"
                f".{self.name}{{max-width:{self.width}px;width:100%;height:auto;margin-bottom:1rem}}"
                f".{self.name} a{{text-decoration:none}}"
                f".{self.name} a:hover text{{text-decoration:underline}}"
                f'html[data-theme="dark"] .{self.name}{{--loop-person:{DARK.person};'
                f"--loop-tint:{DARK.tint}}}"
                "</style>"
            )
        role = "group" if self.inline else "img"  # the links of a group can be reached
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}"'
            f' width="{self.width}" height="{self.height}" class="{self.name}" role="{role}"'
            f' {names} font-family="{FONT}">'
        )
        words = (
            f'<title id="{self.name}-title">{escape(self.title)}</title>'
            f'<desc id="{self.name}-words">{escape(self.words)}</desc>'
        )
        return "\n".join([head, words, *([style] if style else []), *self.parts, "</svg>", ""])


def symbols(words: str, size: int) -> str:
    """Italics with indices: ``K_e, T_L`` and Greek letters as they are."""
    made = []
    for word in words.split(" "):
        base, _, index = word.partition("_")
        rest = "," if index.endswith(",") else ""
        sub = index.rstrip(",")
        part = f'<tspan font-style="italic">{escape(base)}</tspan>'
        if sub:
            down = round(0.25 * size)
            part += (
                f'<tspan font-size="{round(0.7 * size)}" dy="{down}">{escape(sub)}</tspan>'
                f'<tspan dy="-{down}">{rest or "&#8203;"}</tspan>'
            )
        made.append(part)
    return " ".join(made)


def plain(colours: Colours) -> str:
    """The loop without the places."""
    d = Drawing(
        720,
        212,
        "A person in a loop",
        "The target f_t less the output x is the error e. The person answers the error, remnant is "
        "added, and the sum is the stick u. With a disturbance it moves the controlled element, "
        "whose output x goes back.",
        colours,
        "skhoid-loop",
    )
    y, back = 96, 188
    d.line((12, y), (50, y))
    d.text(22, y - 14, "f_t", 24, symbol="")
    d.summing(64, y)
    d.line((78, y), (136, y))
    d.text(104, y - 14, "e", 24, symbol="")
    d.box(205, y, 138, 76, fill=colours.tint, stroke=colours.person, rx="12")
    d.text(205, y + 8, "person", 25, bold="", colour=colours.person)
    d.line((274, y), (318, y))
    d.line((332, 34), (332, y - 14), colour=colours.soft)
    d.text(332, 24, "remnant", 22, colour=colours.soft)
    d.summing(332, y)
    d.line((346, y), (432, y))
    d.text(388, y - 14, "u", 24, symbol="")
    d.line((446, 34), (446, y - 14), colour=colours.soft)
    d.text(466, 24, "disturbance", 22, colour=colours.soft)
    d.summing(446, y)
    d.line((460, y), (502, y))
    d.box(570, y, 136, 76)
    d.text(570, y - 5, "controlled", 23)
    d.text(570, y + 21, "element", 23)
    d.line((638, y), (710, y))
    d.text(676, y - 14, "x", 24, symbol="")
    d.line((672, y), (672, back), (64, back), (64, y + 14))
    d.minus(42, y + 32)
    return d.whole()


def marked(d: Drawing, place: str, mark: tuple[float, float], draw: Callable[[], None]) -> None:
    """A place: what ``draw`` adds, under its number, as a link where the page has the groups."""
    number = MARKS.index(place) + 1
    if d.inline:
        d.add(f'<a href="#place-{place}">')
    draw()
    x, y = mark
    d.add(
        f'<circle cx="{x:g}" cy="{y:g}" r="13" fill="{VERMILION}"/>'
        f'<text x="{x:g}" y="{y + 6.5:g}" font-size="19" font-weight="bold" text-anchor="middle"'
        f' fill="#ffffff">{number}</text>'
    )
    if d.inline:
        d.add("</a>")


def stage(d: Drawing, place: str, x: float, y: float, shape: str) -> None:
    """A box of the chain: its name, and a symbol or a small curve."""

    def draw() -> None:
        d.box(x, y, 108, 66)
        d.text(x, y - 9, place, 19)
        if shape.startswith("M"):
            d.add(
                f'<path d="{shape}" transform="translate({x:g} {y + 14:g})" fill="none"'
                f' stroke="{d.colours.person}" stroke-width="2.5" stroke-linejoin="round"/>'
            )
        else:
            d.text(x, y + 20, shape, 21, symbol="", colour=d.colours.person)

    marked(d, place, (x - 54, y - 33), draw)


def loop_map(colours: Colours, inline: bool = False) -> str:
    """The loop with the places where effects act."""
    d = Drawing(
        720,
        452,
        "Where effects act in the loop",
        "The error e enters the person: 1 input, 2 delay, 3 gain, 4 a further path from the "
        "target, the output, motion or a disturbance, 5 the command, 6 the spring of limb and "
        "stick, 7 a sum, 8 the output. Remnant is added, and u leaves the person. With a "
        "disturbance f_d it moves the controlled element, whose output x goes back to the target "
        "f_t. 9 is inside the recursion of a machine.",
        colours,
        "skhoid-loop-map",
        inline,
    )
    top, low, left = 118, 338, 62
    d.box(422, 228, 580, 344, fill=colours.tint, stroke=colours.person, rx="18")
    d.text(262, 238, "person", 30, bold="", colour=colours.person)
    d.line((10, top), (left - 14, top))
    d.text(20, top - 16, "f_t", 24, symbol="")
    d.line((left + 14, top), (177, top))
    d.text(106, top - 14, "e", 24, symbol="")
    d.summing(left, top)
    stage(d, "input", 231, top, "M-30 11L-12 0H12L30 -11")
    d.line((285, top), (313, top))
    stage(d, "delay", 367, top, "τ_e")
    d.line((421, top), (449, top))
    stage(d, "gain", 503, top, "K_e, T_L")
    d.line((557, top), (604, top))

    def path() -> None:
        d.line((618, 34), (618, top - 14), colour=colours.person)
        d.text(618, 25, "target, output, motion, …", 20, anchor="end")
        d.summing(618, top)
        d.text(640, top + 6, "path", 20, anchor="start")

    marked(d, "path", (646, top - 28), path)
    d.line((618, top + 14), (618, low - 33))
    stage(d, "command", 618, low, "M-30 11H-16C-4 11 -8 -9 8 -9H30")
    d.line((564, low), (528, low))
    stage(d, "spring", 474, low, "M-32 1H-20L-15 -8L-6 10L3 -8L12 10L18 1H32")

    d.text(474, low + 54, "limb and stick", 20, colour=colours.soft)

    def inside() -> None:
        d.line((404, low), (404, 268), (546, 268), (546, low - 2), colour=colours.soft, dashed="")
        d.text(416, 259, "inside (machines)", 20, anchor="start")

    marked(d, "inside", (395, 252), inside)
    d.line((420, low), (388, low))

    def added() -> None:
        d.line((374, low - 46), (374, low - 14), colour=colours.person)
        d.summing(374, low)
        d.text(326, low - 52, "sum", 20, anchor="start")

    marked(d, "sum", (308, low - 59), added)
    d.line((360, low), (330, low))
    stage(d, "output", 276, low, "M-30 9H-17L17 -9H30")
    d.line((222, low), (188, low))
    d.line((174, low + 90), (174, low + 14), colour=colours.soft)
    d.text(142, low + 108, "remnant", 20, colour=colours.soft, anchor="start")
    d.summing(174, low)
    d.line((160, low), (left + 14, low))
    d.text(106, low - 12, "u", 24, symbol="")
    d.line((left, low + 90), (left, low + 14), colour=colours.soft)
    d.text(8, low + 108, "disturbance", 20, colour=colours.soft, anchor="start")
    d.summing(left, low)
    d.line((left, low - 14), (left, 262))
    d.box(left, 228, 108, 68)
    d.text(left, 223, "controlled", 20)
    d.text(left, 246, "element", 20)
    d.line((left, 194), (left, top + 14))
    d.text(left + 18, 170, "x", 24, symbol="")
    d.minus(left - 28, top + 26)
    return d.whole()


def logo(colours: Colours) -> str:
    """A loop, and the piece that it was missing."""
    d = Drawing(
        64, 64, "skhoid", "A loop, with the piece that it was missing.", colours, "skhoid-logo"
    )
    # The signal goes round to the left, and comes back from below.
    d.add(
        '<path d="M38 15H22A11 11 0 0 0 11 26V42A11 11 0 0 0 22 53H38A11 11 0 0 0 49 42V40"'
        f' fill="none" stroke="{colours.person}" stroke-width="8"/>'
        f'<path d="M49 27L60 41H38Z" fill="{colours.person}"/>'
        f'<circle cx="49" cy="14" r="11" fill="{VERMILION}"/>'
        '<path d="M43 14h12M49 8v12" stroke="#ffffff" stroke-width="3.5"/>'
    )
    return d.whole()


def pictures() -> dict[str, str]:
    """Every file by its name."""
    return {
        "loop-light.svg": plain(LIGHT),
        "loop-dark.svg": plain(DARK),
        "loop-map-light.svg": loop_map(LIGHT),
        "loop-map-dark.svg": loop_map(DARK),
        "loop-map-inline.svg": loop_map(Colours.of_site(), inline=True),
        "logo.svg": logo(LIGHT),
        "logo-dark.svg": logo(DARK),
        "favicon.svg": logo(LIGHT),
    }


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for name, text in pictures().items():
        (folder / name).write_text(text, encoding="utf-8")
        print(folder / name)
