"""Draw the moving picture of ``skhoid demo`` in README.md from what the program prints.

    pip install pyte
    python tools/draw_demo.py

Runs the demo in a terminal of 80 columns and writes ``docs/_static/demo.svg``: what stood on the
screen, up to the verdict and its parameters. Pauses are cut to ``PAUSE`` seconds. Readers who asked
for less motion see the last screen only.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import pty
import struct
import subprocess
import sys
import tempfile
import termios
import time
from pathlib import Path
from xml.sax.saxutils import escape

import pyte

TARGET = Path(__file__).resolve().parents[1] / "docs" / "_static" / "demo.svg"
COMMAND = "skhoid demo"
LAST = "Baseline:"  # the recording ends before the line with these words
COLUMNS, ROWS = 80, 24
KEYSTROKE, PAUSE, HOLD = 0.07, 1.5, 8.0  # s: of the typing, at most of the demo, at the end
CELL, LINE, MARGIN, BAR = 8.4, 20.0, 16.0, 30.0  # px
PAPER, INK, DIM = "#1b1f24", "#e6e8eb", "#9aa4af"
COLOURS = {  # of the terminal: Okabe and Ito's
    "red": "#D55E00",
    "green": "#1fbf8f",
    "brown": "#E69F00",
    "blue": "#56B4E9",
    "magenta": "#CC79A7",
    "cyan": "#56B4E9",
    "brightblack": DIM,
}
Screen = tuple[tuple[tuple[str, str, bool], ...], ...]  # rows of runs: text, colour, whether bold


def recorded(folder: Path) -> list[tuple[float, str]]:
    """What the demo wrote, and when, in seconds from its start."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": str(COLUMNS)}
    command = [sys.executable, "-m", *COMMAND.split()]
    started, written = time.monotonic(), []
    with subprocess.Popen(command, cwd=folder, stdout=slave, stderr=slave, env=environment) as run:
        os.close(slave)
        while True:
            try:
                data = os.read(master, 65536)
            except OSError:  # the terminal is closed: the program has ended
                break
            if not data:
                break
            written.append((time.monotonic() - started, data.decode("utf-8", "replace")))
    os.close(master)
    if run.returncode:
        raise SystemExit(f"{COMMAND} failed:\n{''.join(text for _, text in written)}")
    return written


def until(last: str, written: list[tuple[float, str]]) -> list[tuple[float, str]]:
    """What was written before the line that holds ``last``."""
    kept, so_far = [], ""
    for at, text in written:
        so_far += text
        if last in so_far:
            end = so_far.rindex("\n", 0, so_far.index(last)) + 1
            return [*kept, (at, text[: end - len(so_far)])]
        kept.append((at, text))
    raise SystemExit(f"The demo does not print {last!r}: change LAST in {__file__}.")


def seen(screen: pyte.Screen) -> Screen:
    """The rows of a screen as runs of one style."""
    rows = []
    for y in range(ROWS):
        runs: list[tuple[str, str, bool]] = []
        for x in range(COLUMNS):
            cell = screen.buffer[y][x]
            style = COLOURS.get(cell.fg, INK), bool(cell.bold)
            if runs and runs[-1][1:] == style:
                runs[-1] = (runs[-1][0] + cell.data, *style)
            else:
                runs.append((cell.data, *style))
        rows.append(tuple(runs))
    return tuple(rows)


def played(written: list[tuple[float, str]]) -> list[tuple[float, Screen]]:
    """Screens and when each begins: the command is typed, then the demo runs."""
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.Stream(screen)
    stream.feed("\x1b[34m$\x1b[0m ")
    screens, now = [(0.0, seen(screen))], 0.8
    for letter in COMMAND:
        stream.feed(letter)
        screens.append((now, seen(screen)))
        now += KEYSTROKE
    now += 0.4
    stream.feed("\r\n")
    screens.append((now, seen(screen)))
    before = 0.0
    for at, text in written:
        now += min(at - before, PAUSE)
        before = at
        stream.feed(text)
        if (shown := seen(screen)) != screens[-1][1]:
            screens.append((now, shown))
    return screens


def row_of(runs: tuple[tuple[str, str, bool], ...], name: str) -> str:
    """A row as one text element; every run keeps its columns in any font."""
    parts, column = [], 0
    for text, colour, bold in runs:
        words = text.rstrip()
        blank = len(words) - len(words.lstrip())
        words, first = words.lstrip(), column + blank
        column += len(text)
        if words:
            weight = ' font-weight="700"' if bold else ""
            parts.append(
                f'<text x="{first * CELL:.1f}" textLength="{len(words) * CELL:.1f}" '
                f'fill="{colour}"{weight}>{escape(words)}</text>'
            )
    return f'<g id="{name}">{"".join(parts)}</g>'


def drawn(screens: list[tuple[float, Screen]]) -> str:
    """The film: all screens side by side behind a window, moved in steps."""
    width, height = COLUMNS * CELL + 2 * MARGIN, ROWS * LINE + BAR + MARGIN
    names: dict[tuple, str] = {}
    strips = []
    for i, (_, screen) in enumerate(screens):
        uses = []
        for y, runs in enumerate(screen):
            if "".join(text for text, *_ in runs).strip():
                name = names.setdefault(runs, f"r{len(names)}")
                uses.append(f'<use href="#{name}" y="{BAR + (y + 0.75) * LINE:.1f}"/>')
        strips.append(f'<g transform="translate({i * width + MARGIN:.1f})">{"".join(uses)}</g>')
    whole = screens[-1][0] + HOLD
    stops = [
        f"{100 * at / whole:.2f}%{{transform:translateX({-i * width:.1f}px)}}"
        for i, (at, _) in enumerate(screens)
    ]
    last = f"translateX({-(len(screens) - 1) * width:.1f}px)"
    text = "\n".join("".join(run[0] for run in runs).rstrip() for runs in screens[-1][1])
    dots = "".join(f'<circle cx="{18 + 16 * i}" cy="15" r="4.5" fill="{DIM}"/>' for i in range(3))
    rows = "\n".join(row_of(runs, name) for runs, name in names.items())
    films = "\n".join(strips)
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" \
width="{width:.0f}" height="{height:.0f}" role="img" aria-labelledby="title words">
<title id="title">skhoid demo, recorded</title>
<desc id="words">{escape(text.strip())}</desc>
<style>
#film{{transform:{last};animation:play {whole:.2f}s steps(1,end) infinite}}
@keyframes play{{{"".join(stops)}100%{{transform:{last}}}}}
@media (prefers-reduced-motion:reduce){{#film{{animation:none}}}}
svg{{font:14px ui-monospace,SFMono-Regular,Menlo,Consolas,"DejaVu Sans Mono",monospace}}
text{{white-space:pre}}
</style>
<defs>
{rows}
</defs>
<rect width="100%" height="100%" rx="8" fill="{PAPER}"/>
{dots}
<g id="film">
{films}
</g>
</svg>
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=TARGET, help="the SVG (default: %(default)s)")
    out = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        written = recorded(Path(folder))
    screens = played(until(LAST, written))
    out.write_text(drawn(screens), encoding="utf-8")
    print(f"{out}: {len(screens)} screens, {screens[-1][0]:.1f} s, {out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
