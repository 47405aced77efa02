"""The pictures of `docs/examples.md`, by its commands: `python docs/figures/examples.py [NAME ...]`."""

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from drawing import IMAGES, in_few_colors
from PIL import Image, ImageOps

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "examples.md"


def trimmed(picture: Image.Image, margin: int = 10) -> Image.Image:
    """The picture without the white around it, but for a margin in pixels."""
    left, upper, right, lower = ImageOps.invert(picture).getbbox() or (0, 0, *picture.size)
    around = (left - margin, upper - margin, right + margin, lower + margin)
    return ImageOps.expand(picture, margin, "white").crop(tuple(edge + margin for edge in around))


def main(names: list[str]) -> None:
    """Runs each command of the page that writes a picture."""
    for command in re.findall(r"^python (examples/.* --plot .*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE):
        script, *options, _ = shlex.split(command)
        name = Path(script).stem
        if names and name not in names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "picture.png"
            subprocess.run([sys.executable, ROOT / script, *options, picture], check=True)
            file = IMAGES / f"example-{name.replace('_', '-')}.png"
            in_few_colors(trimmed(Image.open(picture).convert("RGB")), file)
        print(f"{file.relative_to(ROOT)}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
