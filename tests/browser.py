"""The browser that tests look at pages with: the Chromium of the system, driven by playwright-core of the viewer."""

import shutil
import subprocess
from pathlib import Path

import pytest

VIEWER = Path(__file__).parents[1] / "gmmjax" / "reporting" / "viewer"


def _chromium() -> str | None:
    """The one that is installed; Ubuntu's package is a script without one, which fails where there are no snaps."""
    names = ("chromium", "chromium-browser", "google-chrome")
    for path in filter(None, map(shutil.which, names)):
        if subprocess.run([path, "--version"], capture_output=True, check=False).returncode == 0:
            return path
    return None


CHROMIUM = _chromium()
MISSING = [
    *([] if CHROMIUM else ["Chromium"]),
    *([] if shutil.which("node") else ["node"]),
    *([] if (VIEWER / "node_modules" / "playwright-core").is_dir() else ["`npm ci` in gmmjax/reporting/viewer"]),
]
needs_browser = pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)}")
