"""What commands print and write, without what differs from run to run: times, folders, the machine.

python -m tests.recorded.commands           what differs from the recorded output
python -m tests.recorded.commands --write   records the output of this code
"""

import argparse
import contextlib
import difflib
import io
import json
import os
import re
import tempfile
from pathlib import Path

from gmmjax.cli import main

FILE = Path(__file__).parent / "results" / "commands.txt"

COMMANDS = (
    "simulate gaussians --out scene --points 200 --seed 3",
    "detect scene/before.ply scene/after.ply --out found",
    "detect scene/before.ply scene/after.ply --out greedy --method greedy --restarts 2",
    "detect scene/before.ply scene/missing.ply --out never",
    "detect scene/before.ply scene/after.ply --out found",
    "fit scene/before.ply --out mixture --restarts 2 --quiet",
    "evaluate gaussians --conditions *low* --families separation --seeds 1 --points 100 --methods joint voxels",
)
FILES = ("found/changes.json", "found/config.toml", "greedy/changes.json")
# Of the terminal and the records: seconds, and what the machine is called.
TIMES = re.compile(r" +(\d+\.\d\d|s)$", re.MULTILINE)
CHANGING = ("seconds", "device", "gmmjax_version", "created")


def transcript() -> str:
    """The commands, what they print, and the records that they write; in a folder of its own."""
    text = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for command in COMMANDS:
            output, errors = io.StringIO(), io.StringIO()
            with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
                status = main(command.split())
            printed = output.getvalue() + errors.getvalue()
            text.append(f"$ gmmjax {command}\n{_without_times(printed, folder)}exit status {status}\n")
        for name in FILES:
            text.append(f"{name}\n{_without_times(_record(Path(name)), folder)}\n")
    return "\n".join(text)


def _without_times(text: str, folder: str) -> str:
    text = TIMES.sub("", text.replace(os.path.realpath(folder), "FOLDER").replace(folder, "FOLDER"))
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n" if text else ""


def _record(path: Path) -> str:
    if path.suffix != ".json":
        return path.read_text()
    content = json.loads(path.read_text())
    return "\n".join(f"{name}: {json.dumps(_without_changing(part))}" for name, part in content.items())


def _without_changing(value: object) -> object:
    """Numbers to five digits: the last ones are the rounding of the machine."""
    if isinstance(value, dict):
        return {name: _without_changing(part) for name, part in value.items() if name not in CHANGING}
    if isinstance(value, list):
        return [_without_changing(part) for part in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="record the output of this code")
    found = transcript()
    if parser.parse_args().write:
        FILE.write_text(found)
    else:
        differences = list(difflib.unified_diff(FILE.read_text().splitlines(), found.splitlines(), lineterm="", n=1))
        print("\n".join(differences) or "equal")
        raise SystemExit(bool(differences))
