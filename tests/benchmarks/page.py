"""What a benchmark measured, in the place that the documentation has for it."""

import contextlib
import datetime
import importlib.metadata
import os
from pathlib import Path

PACKAGES = ("gmmjax", "jax", "numpy", "distributed")


def put(page: Path | None, name: str, text: str) -> None:
    """Replaces what stands between `<!-- NAME: begin -->` and `<!-- NAME: end -->`; without a page it is printed.

    Where and when it was measured stands above it.

    Raises:
        SystemExit: the page has no such marks.
    """
    text = f"{conditions()}\n\n{text}"
    if page is None:
        print(text)
        return
    marks = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    content = page.read_text()
    if not all(content.count(mark) == 1 for mark in marks):
        raise SystemExit(f"{page}: has no place for this; write {marks[0]} and {marks[1]} where it shall stand")
    before, rest = content.split(marks[0])
    after = rest.split(marks[1])[1]
    page.write_text(f"{before}{marks[0]}\n\n{text}\n\n{marks[1]}{after}")


def conditions() -> str:
    """The day and the machine."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    processor = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "CPU unknown")
    versions = []
    for name in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions.append(f"{name} {importlib.metadata.version(name)}")
    cores = len(os.sched_getaffinity(0))
    return f"{datetime.date.today()}, {processor}, {cores} cores; {', '.join(versions)}."
