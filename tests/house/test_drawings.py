"""The drawings of the documentation are those that their scripts make."""

import runpy
import xml.etree.ElementTree as ET

import pytest
from support.places import ROOT

from skhoid.effects.composition import PLACES

STATIC = ROOT / "docs" / "_static"
LOOP = runpy.run_path(str(ROOT / "tools" / "draw_loop.py"))
PICTURES = LOOP["pictures"]()
SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize("name", PICTURES)
def test_file_is_what_the_script_makes(name):
    assert (STATIC / name).read_text(encoding="utf-8") == PICTURES[name], (
        "python tools/draw_loop.py writes it anew"
    )


@pytest.mark.parametrize("name", PICTURES)
def test_picture_is_told_in_words(name):
    root = ET.fromstring(PICTURES[name])
    told = [root.find(f"{SVG}{tag}") for tag in ("title", "desc")]
    assert all(part is not None and part.text for part in told)
    assert root.get("aria-labelledby").split() == [part.get("id") for part in told]


def test_map_has_every_place_once():
    assert sorted(LOOP["MARKS"]) == sorted(PLACES)
    root = ET.fromstring(PICTURES["loop-map-inline.svg"])
    links = [link.get("href") for link in root.iter(f"{SVG}a")]
    assert sorted(links) == sorted(f"#place-{place}" for place in PLACES)
    words = " ".join(root.itertext())
    assert all(place in words for place in PLACES)
