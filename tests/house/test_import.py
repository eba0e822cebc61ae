"""What importing skhoid must not load."""

import subprocess
import sys


def test_import_is_light():
    check = "import sys, skhoid; print([m for m in ('matplotlib', 'numba') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", check], capture_output=True, text=True, check=True, cwd="/"
    )
    assert done.stdout.strip() == "[]"
