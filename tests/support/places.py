"""Where the checkout is, and the reference data beside it, which tests skip without."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"
REFERENCE = SHARED / "reference"
RECORDINGS = SHARED / "data"
