"""The folder of `gmmjax evaluate thesis`: settings, journal, page and tables."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

from gmmjax.clouds import FolderKind, atomic_write, check_output_folder, read_json
from gmmjax.errors import InputError, shown
from gmmjax.thesis.chapter4 import Journal, Plan, ThesisResults
from gmmjax.thesis.report.chapter_page import thesis_html
from gmmjax.thesis.report.chapter_text import THESIS_TEXT

SCHEMA_VERSION = 1
SETTINGS, JOURNAL, PAGE = "settings.json", "progress.jsonl", "index.html"
TABLES = tuple(f"figure-{figure}.csv" for figure in THESIS_TEXT)
FOLDER = FolderKind("run of the thesis", SETTINGS, "thesis", (JOURNAL, PAGE, *TABLES))


def open_folder(folder: Path, plan: Plan, *, overwrite: bool = False) -> Journal:
    """The journal of a folder, which is created where needed.

    Args:
        folder: of an earlier run with the same plan, or empty, or none yet.
        plan: extent of the run.
        overwrite: delete an earlier run, and begin anew.

    Raises:
        InputError: the folder holds something else or a run of another plan, or cannot be written.
    """
    check_output_folder(folder, FOLDER, overwrite=True)
    settings = _settings(plan)
    if overwrite:
        for name in (*FOLDER.others, FOLDER.marker):
            (folder / name).unlink(missing_ok=True)
    if (folder / SETTINGS).exists():
        _check_same(folder, settings)
    else:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / SETTINGS) as file:
            file.write((json.dumps(settings, indent=2) + "\n").encode())
    return Journal(folder / JOURNAL)


def write_results(folder: Path, results: ThesisResults) -> Sequence[str]:
    """Writes the page and one CSV file for each table.

    Args:
        folder: one that `open_folder` has opened.
        results: of `run_chapter`.

    Returns:
        The names of the files.

    Raises:
        InputError: a file that cannot be written.
    """
    contents = {table.file_name: table.to_csv() for part in results.parts for table in part.tables}
    contents[PAGE] = thesis_html(results)
    for name, content in contents.items():
        with atomic_write(folder / name) as file:
            file.write(content.encode())
    return tuple(contents)


def _settings(plan: Plan) -> dict[str, object]:
    from gmmjax import __version__

    return {"schema_version": SCHEMA_VERSION, "gmmjax": __version__, "thesis": dataclasses.asdict(plan)}


def _check_same(folder: Path, settings: dict[str, object]) -> None:
    there = read_json(folder / SETTINGS, "--overwrite begins anew")
    if there == settings:
        return
    if {**there, "thesis": None} != {**settings, "thesis": None}:
        differences = [f"another version of gmmjax, {shown(there.get('gmmjax'))}"]
    else:
        own = dict(settings["thesis"])  # type: ignore[call-overload]
        others = there["thesis"] if isinstance(there["thesis"], dict) else {}
        differences = [
            f"{name} {shown(others.get(name))}, not {value}" for name, value in own.items() if others.get(name) != value
        ]
    raise InputError(
        f"{folder}: holds a run of other settings ({'; '.join(differences)}); give the same options again to go on "
        "with it, --overwrite to begin anew, or another folder"
    )
