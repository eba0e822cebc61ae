"""Record the workbench at work, and the report that it saves, for the documentation.

    pip install -e ".[workbench,browser]" pillow
    python tools/record_workbench.py [--frames FOLDER]

Run it after the page has changed, and look at the result: a file of four simulated runs is opened
in ``skhoid workbench``, and a headless Chromium goes by mouse from its columns to the report. Takes
some minutes, and writes into ``docs/_static`` the recording, ``workbench.webp``, its last picture,
``workbench.png``, and the top of the report, ``report.png``. Pointer and rings are drawn by this
script, the search is a time-lapse, and of folders of this machine nothing is shown; all else is the
page itself. ``--frames`` also writes each picture into a folder.
"""

from __future__ import annotations

import argparse
import base64
import io
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image, ImageChops, ImageDraw, ImageFont

from skhoid import make_tracking_runs
from skhoid.effects import Bias, DeadZone

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "_static"
NAME = "pitch-tracking.csv"
WIDTH, HEIGHT = 1300, 950  # px: all plots can be seen at once
MOST, MOST_STILL = 1_200_000, 250_000  # bytes
LONGEST = 300.0  # s, that anything may take
LAPSE = 6  # pictures of the search
STEP, PRESS, GLANCE, LOOK, READ, END = 50, 200, 450, 1000, 1500, 2000  # ms
TIP = [(0, 0), (0, 17), (4, 13.4), (6.8, 19.6), (9.6, 18.3), (6.9, 12.2), (12.4, 12.2)]
RING, INK = "#D55E00", "#1b1f24"
FINE = 4  # the pointer is drawn so many times as large, then made smaller
COLOURS = 64  # of the recording: half its size, and no difference is seen
COLOURS_STILL = 128
NEAR = 6  # levels in which two colours of a palette differ at least

NAMED = '.sk-candidate[aria-label="{}"]'
ADD = '[aria-label="Add {}"]'
PLOT = '.sk-plot[data-sk-key="plot time"] .u-over'
SLIDER = '.sk-added[aria-label="dead zone"] input[type="range"]'
SHARE = "const s = document.querySelector(arguments[0]); return (s.value-s.min)/(s.max-s.min)"
HANDLE = 8  # px, half of a slider's
STATUS = "document.querySelector('.sk-status').textContent"
HIDE_FOLDER = f"const s = {STATUS}; {STATUS} = s.replace(/\\S*[/\\\\]/, '')"

Point = tuple[float, float]


def write_runs(path: Path) -> None:
    """Four runs of a person, named as a lab may name them."""
    X, y = make_tracking_runs(
        "C1",
        4,
        effects=DeadZone(width=0.3) + Bias(level=0.05),
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        remnant_intensity=0.1,
        random_state=0,
    )
    names = {"e": "Tracking error (deg)", "x": "pitch", "f_t": "target"}
    table = X.rename(columns=names).assign(stick=y)
    table.index = table.index.set_names(["trial", "Time [s]"])
    table.reset_index().round(6).to_csv(path, index=False)


@contextmanager
def served(path: Path) -> Iterator[str]:
    """The address of a workbench on a file."""
    command = [sys.executable, "-m", "skhoid", "workbench", path.name, "--no-browser"]
    command += ["--session", "session"]
    with subprocess.Popen(command, cwd=path.parent, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            if found is None:
                raise SystemExit("The workbench has not started: see what it says above.")
            yield found[0]
        finally:
            server.terminate()


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless Chromium; a page asks for no motion, so that no picture is of something half."""
    try:
        from selenium import webdriver
    except ImportError:
        raise SystemExit('Selenium is missing: pip install -e ".[browser]"') from None
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    control = shutil.which("chromedriver")
    if program is None or control is None:
        raise SystemExit(
            "Chromium or its driver is missing: apt-get install chromium chromium-driver"
        )
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--lang=en"):
        options.add_argument(argument)
    driver = webdriver.Chrome(options, webdriver.ChromeService(control))
    try:
        size = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        wanted = {"prefers-color-scheme": "light", "prefers-reduced-motion": "reduce"}
        features = [{"name": name, "value": value} for name, value in wanted.items()]
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        driver.execute_cdp_cmd("Emulation.setScrollbarsHidden", {"hidden": True})
        driver.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "deny"})
        yield driver
    finally:
        driver.quit()


def with_pointer(picture: Image.Image, at: Point, pressed: bool) -> Image.Image:
    """The picture with a mouse pointer, and a ring around it while its button is down."""
    reach = 24
    overlay = Image.new("RGBA", (2 * reach * FINE, 2 * reach * FINE))
    draw = ImageDraw.Draw(overlay)
    if pressed:
        ring = [(reach - 15) * FINE, (reach + 15) * FINE]
        box = (ring[0], ring[0], ring[1], ring[1])
        draw.ellipse(box, fill="#D55E0030", outline=RING, width=3 * FINE)
    arrow = [((reach + x) * FINE, (reach + y) * FINE) for x, y in TIP]
    draw.polygon(arrow, fill=INK)
    draw.line([*arrow, *arrow[:2]], fill="white", width=round(1.6 * FINE), joint="curve")
    overlay = overlay.resize((2 * reach, 2 * reach), Image.Resampling.LANCZOS)
    picture = picture.copy()
    picture.paste(overlay, (round(at[0]) - reach, round(at[1]) - reach), overlay)
    return picture


def with_note(picture: Image.Image, text: str) -> Image.Image:
    """The picture with a word of the script's own at its lower edge."""
    picture = picture.copy()
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(18)
    left, top, right, bottom = draw.textbbox((24, HEIGHT - 44), text, font=font)
    draw.rounded_rectangle((left - 10, top - 8, right + 10, bottom + 8), 6, fill=INK)
    draw.text((24, HEIGHT - 44), text, font=font, fill="white")
    return picture


class Film:
    """Pictures, and for how many milliseconds each is shown."""

    def __init__(self) -> None:
        self.pictures: list[Image.Image] = []
        self.times: list[int] = []

    def add(self, picture: Image.Image, ms: int) -> None:
        if self.pictures and not ImageChops.difference(self.pictures[-1], picture).getbbox():
            self.times[-1] += ms
        else:
            self.pictures.append(picture)
            self.times.append(ms)

    def save(self, path: Path) -> None:
        """In few colours, but sharp: lines and letters suffer from a lossy file."""
        some = self.pictures[:: max(len(self.pictures) // 6, 1)]
        sheet = Image.new("RGB", (WIDTH, HEIGHT * len(some)))
        for i, picture in enumerate(some):
            sheet.paste(picture, (0, HEIGHT * i))
        palette = in_few_colours(sheet, COLOURS)
        first, *others = [
            picture.quantize(palette=palette, dither=Image.Dither.NONE).convert("RGB")
            for picture in self.pictures
        ]
        how = {"lossless": True, "quality": 80, "method": 4, "loop": 0}
        first.save(path, save_all=True, append_images=others, duration=self.times, **how)

    def save_each(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for i, (picture, ms) in enumerate(zip(self.pictures, self.times, strict=True)):
            picture.save(folder / f"{i:02d}-{ms}ms.png")


def in_few_colours(picture: Image.Image, count: int) -> Image.Image:
    """The most frequent ones, and some that cover what else there is."""
    found = sorted(picture.getcolors(picture.width * picture.height), reverse=True)
    levels = picture.quantize(count // 2, Image.Quantize.MAXCOVERAGE).getpalette()
    others = zip(*[iter(levels)] * 3, strict=True)
    kept: list[tuple[int, ...]] = []
    for colour in (*(colour for _, colour in found[: count // 2]), *others):
        # Pillow takes a near one for the nearest: white would become grey.
        if all(max(abs(a - b) for a, b in zip(colour, one, strict=True)) > NEAR for one in kept):
            kept.append(colour)
    palette = Image.new("P", (1, 1))
    palette.putpalette([level for colour in kept for level in colour])
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


class Hand:
    """A mouse on the page, and the film of what it does."""

    def __init__(self, driver: Any, film: Film) -> None:
        self.driver, self.film = driver, film
        self.at: Point = (WIDTH * 0.55, HEIGHT * 0.6)
        self.pressed = False

    def js(self, code: str, *arguments: Any) -> Any:
        return self.driver.execute_script(code, *arguments)

    def wait(self, code: str) -> None:
        """Until an expression of the page holds."""
        end = time.monotonic() + LONGEST
        while not self.js(f"return {code}"):
            if time.monotonic() > end:
                raise SystemExit(f"The page did not come to this: {code}")
            time.sleep(0.05)

    def settle(self) -> None:
        """Until the page computes nothing and has drawn what it has."""
        self.wait("!document.querySelector('[aria-busy]')")
        time.sleep(0.25)

    def picture(self) -> Image.Image:
        data = self.driver.execute_cdp_cmd("Page.captureScreenshot", {})["data"]
        plain = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
        return with_pointer(plain, self.at, self.pressed)

    def show(self, ms: int) -> None:
        self.film.add(self.picture(), ms)

    def mouse(self, kind: str) -> None:
        down = kind != "mouseReleased" and (self.pressed or kind == "mousePressed")
        button = "left" if down or kind == "mouseReleased" else "none"
        event = {"type": kind, "x": self.at[0], "y": self.at[1], "button": button}
        event |= {"buttons": int(down), "clickCount": int(kind != "mouseMoved")}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def go(self, to: Point) -> None:
        """Move there in steps, slow at first and at last."""
        (x, y), (right, down) = self.at, to
        steps = 3 if abs(right - x) + abs(down - y) > 300 else 2
        for step in range(1, steps + 1):
            share = (step / steps) ** 2 * (3 - 2 * step / steps)
            self.at = (x + share * (right - x), y + share * (down - y))
            self.mouse("mouseMoved")
            self.show(STEP)

    def drag(self, to: Point, ms: int) -> None:
        self.at = to
        self.mouse("mouseMoved")
        self.settle()
        self.show(ms)

    def press(self) -> None:
        self.show(PRESS)
        self.pressed = True
        self.mouse("mousePressed")
        self.show(PRESS)

    def let_go(self) -> None:
        self.mouse("mouseReleased")
        self.pressed = False

    def click(self, selector: str) -> None:
        """At a place of the button that leaves its word to be read."""
        while (to := self.middle(selector, 0.75, 0.75)) != self.at:
            self.go(to)
        self.press()
        self.let_go()

    def middle(self, selector: str, x: float = 0.5, y: float = 0.5) -> Point:
        """A point of an element, in shares of its size."""
        box = self.js(
            "const b = document.querySelector(arguments[0])?.getBoundingClientRect();"
            "return b && [b.left, b.top, b.width, b.height]",
            selector,
        )
        if box is None:
            raise SystemExit(f"The page has no {selector}.")
        left, top, width, height = box
        found = left + x * width, top + y * height
        if not (0 <= found[0] < WIDTH and 0 <= found[1] < HEIGHT):
            raise SystemExit(f"{selector} is out of sight, at {found}.")
        return found

    def on_slider(self, share: float) -> Point:
        """Where the handle of the slider is at a share of its range."""
        (left, y), (right, _) = (self.middle(SLIDER, x) for x in (0, 1))
        return left + HANDLE + share * (right - left - 2 * HANDLE), y

    def top(self) -> float:
        """How far to scroll to bring the plots to the upper edge."""
        code = "return document.querySelector('.sk-data').getBoundingClientRect().top + scrollY"
        return self.js(code) - 12

    def reach(self, selector: str, room: int = 120) -> None:
        """Scroll down until an element and some room below it are in sight."""
        bottom = self.js(
            "return document.querySelector(arguments[0]).getBoundingClientRect().bottom", selector
        )
        if bottom > HEIGHT - room:
            self.scroll(self.js("return scrollY") + bottom - HEIGHT + room)

    def scroll(self, to: float) -> None:
        """At once: a picture on the way costs as much as any other."""
        self.js("scrollTo(0, arguments[0])", to)
        self.mouse("mouseMoved")
        time.sleep(0.3)
        self.show(PRESS)


def choose_columns(hand: Hand) -> None:
    hand.wait("document.getElementById('fit-search').checkVisibility()")
    hand.wait("!document.getElementById('fit-search').disabled")
    hand.settle()
    hand.show(READ)
    hand.click("#fit-search")
    hand.wait("document.querySelector('.sk-plot canvas')")


def search(hand: Hand) -> None:
    """Pictures of the search, evenly over its time."""
    hand.at = (WIDTH * 0.6, HEIGHT * 0.7)
    hand.mouse("mouseMoved")
    begun, seen = time.monotonic(), []
    while not hand.js("return document.querySelector('.sk-verdict').textContent"):
        seconds = time.monotonic() - begun
        if seconds > LONGEST:
            raise SystemExit("The search has not ended.")
        seen.append(with_note(hand.picture(), f"Time-lapse: {seconds:.0f} s"))
        time.sleep(0.5)
    count = min(LAPSE, len(seen))
    for i in range(count):
        hand.film.add(seen[i * (len(seen) - 1) // max(count - 1, 1)], PRESS * 3 // 2)
    hand.settle()
    hand.show(READ)


def try_effects(hand: Hand) -> None:
    """Rest on a card, and add both that were named."""
    hand.scroll(hand.top())
    hand.go(hand.middle(NAMED.format("bias"), 0.4, 0.85))
    hand.wait("/with .?bias/.test(document.querySelector('.sk-plots').textContent)")
    hand.settle()
    hand.show(LOOK)
    for name, ms in {"bias": LOOK, "dead zone": READ}.items():
        hand.reach(NAMED.format(name))
        hand.click(ADD.format(name))
        hand.wait(f"{STATUS}.startsWith('{name} added')")
        hand.settle()
        hand.show(ms)


def look_at_a_window(hand: Hand) -> None:
    hand.go(hand.middle(PLOT, 0.36, 0.8))
    hand.press()
    for share in (0.42, 0.48, 0.54, 0.58):
        hand.drag(hand.middle(PLOT, share, 0.8), 2 * STEP)
    hand.let_go()
    hand.settle()
    hand.show(LOOK)


def move_a_slider(hand: Hand) -> None:
    """Move the threshold by hand, and take that back."""
    hand.reach(".sk-effects > .sk-row", 90)
    place = hand.js(SHARE, SLIDER)
    hand.go(hand.on_slider(place))
    hand.press()
    for step in range(1, 6):
        hand.drag(hand.on_slider(place + step / 5 * (0.55 - place)), 3 * STEP)
    hand.show(LOOK)
    hand.let_go()
    hand.wait(f"{STATUS}.startsWith('width =')")
    hand.settle()
    hand.show(GLANCE)
    hand.scroll(hand.top())
    hand.click('[data-sk-key="undo"]')
    hand.wait(f"{STATUS}.startsWith('Undone')")
    hand.settle()
    hand.show(LOOK)


def save_report(hand: Hand) -> None:
    hand.scroll(0)
    hand.click('[data-sk-key="report"]')
    hand.wait(f"{STATUS}.startsWith('The report is saved')")
    hand.settle()
    hand.js(HIDE_FOLDER)
    hand.show(END)


ACTS = (choose_columns, search, try_effects, look_at_a_window, move_a_slider, save_report)


def picture_of_report(driver: Any, path: Path) -> Image.Image:
    """The top of a report, in a window of 900 px, sharp."""
    size = {"width": 900, "height": 1100, "deviceScaleFactor": 1.5, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    driver.get(path.as_uri())
    time.sleep(1)
    data = driver.execute_cdp_cmd("Page.captureScreenshot", {})["data"]
    return Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")


def recorded() -> tuple[Film, Image.Image]:
    film = Film()
    with tempfile.TemporaryDirectory() as folder, chromium() as driver:
        path = Path(folder) / NAME
        write_runs(path)
        with served(path) as address:
            driver.get(address)
            hand = Hand(driver, film)
            for act in ACTS:
                act(hand)
        return film, picture_of_report(driver, path.parent / "session" / "report.html")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=Path, help="also write each picture into this folder")
    frames = parser.parse_args().frames
    film, of_report = recorded()
    if frames is not None:
        film.save_each(frames)
    moving, still, report = (
        FOLDER / name for name in ("workbench.webp", "workbench.png", "report.png")
    )
    film.save(moving)
    in_few_colours(film.pictures[-1], COLOURS_STILL).save(still, optimize=True)
    in_few_colours(of_report, COLOURS_STILL).save(report, optimize=True)
    print(f"{moving}: {len(film.times)} pictures, {sum(film.times) / 1000:.1f} s")
    for path, most in ((moving, MOST), (still, MOST_STILL), (report, MOST_STILL)):
        size = path.stat().st_size
        print(f"{path}: {size} bytes")
        if size > most:
            raise SystemExit(f"{path} is larger than {most} bytes.")


if __name__ == "__main__":
    main()
