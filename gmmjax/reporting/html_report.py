"""The report: one HTML file that needs nothing else, not even a network."""

import dataclasses
import os
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path, PurePath
from typing import Any

from gmmjax.changes import Changes, GivenCloud, presented
from gmmjax.clouds import PointCloud, atomic_write, system_name
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.reporting.html_changes import changes_panel, explanation_hint, rejected_section, strongest_log_odds
from gmmjax.reporting.html_viewer import keys_dialog, viewer_section
from gmmjax.reporting.packed_points import packed_scene
from gmmjax.reporting.page_parts import page, script, script_json
from gmmjax.reporting.pictures import Pictures, PictureSettings
from gmmjax.reporting.quantities import length_text
from gmmjax.reporting.summary import (
    answer,
    dropped_rows,
    dropped_text,
    object_rows,
    point_counts,
    poses_text,
    registration_text,
    unobserved_text,
    volumes_text,
)

OPTION = re.compile(r"--[a-z][a-z-]*")
CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def write_report(
    changes: Changes, path: str | os.PathLike[str], before: GivenCloud | None = None, after: GivenCloud | None = None
) -> Path:
    """Write the report, one HTML file that needs nothing else, as `gmmjax detect` does.

    Args:
        changes: what was found.
        path: of the file; one that is there is replaced, and its folder is made where needed.
        before: the before cloud that the changes were found in; None: that of `changes.clouds`.
        after: the after cloud, as it was given to the detection; None likewise.

    Returns:
        The path.

    Raises:
        InputError: clouds that are not known, or are not those of the changes; a file that cannot be written.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name the file, such as {target / 'report.html'}")
    clouds, shown = presented(changes, before, after)
    content = report_html(clouds.before, clouds.after, shown).encode()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(target) as file:
            file.write(content)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error
    return target


def report_html(
    before: PointCloud,
    after: PointCloud,
    changes: Changes,
    title: str | None = None,
    close_ups: PictureSettings = PictureSettings(),
    recorded: Changes | None = None,
) -> str:
    """Make the report of a detection, one self-contained page.

    Args:
        before: the before cloud that the changes were found in.
        after: the after cloud, as given; it is shown registered.
        changes: what was found.
        title: of the page; default the names of the two files.
        close_ups: size of the pictures of the changes.
        recorded: the same changes with labels of all points, where the clouds have some of them: how much was not
            observed is a fraction of all. None: the clouds have all.

    Returns:
        HTML, with the points and the viewer inside.
    """
    clouds = Pair(before, after)
    names = Pair(_name(before, "before"), _name(after, "after"))
    pictures, rows = Pictures(clouds, changes, close_ups), object_rows(changes)
    registered = dataclasses.replace(after, points=changes.registration.apply(after.points))
    packed = packed_scene(Pair(before, registered), changes)
    longest = strongest_log_odds(changes)
    panel = changes_panel(changes, rows, pictures.close_ups, longest)
    # The views look at a change from where its close-ups do.
    for record in packed.scene["changes"]:
        if record["label"] in pictures.directions:
            record["towardsEye"] = pictures.directions[record["label"]].tolist()
    recorded = changes if recorded is None else recorded
    main = f"""{_header(clouds, names, recorded, title)}
<div class="bench">
{viewer_section(packed.scene, names, pictures.overview(), changes)}
{panel}
</div>
{explanation_hint(changes)}
{rejected_section(changes, longest)}{_details(changes)}"""
    rest = f"""{keys_dialog()}
{script_json("scene", packed.scene)}
<script type="application/octet-stream" id="points-before">{packed.points.before}</script>
<script type="application/octet-stream" id="points-after">{packed.points.after}</script>
{script("viewer.js")}
{script("report.js")}"""
    content = page(title or f"{names.before} → {names.after}", "report.css", main, rest)
    # Whatever was in a name: a page may hold no control characters.
    return CONTROL_CHARACTERS.sub(lambda found: f"\\x{ord(found[0]):02x}", content)


def _header(clouds: Pair[PointCloud], names: Pair[str], changes: Changes, title: str | None) -> str:
    heading = f'<p class="title"><bdi>{escape(title)}</bdi></p>' if title else ""
    facts = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in _facts(clouds, names, changes).items() if text)
    warnings = "".join(f'<p class="note" role="note"><b>Warning</b> {escape(text)}</p>' for text in changes.warnings)
    return f"""<header>
<div class="actions"><button type="button" id="theme" aria-label="Light or dark" title="Light or dark (t)">◐</button>
<button type="button" id="help" aria-label="Keys" title="Keys (?)">?</button></div>
{heading}<h1>{escape(answer(changes))}</h1>
{warnings}<dl class="facts-of-pair">{facts}</dl>
</header>"""


def _facts(clouds: Pair[PointCloud], names: Pair[str], changes: Changes) -> dict[str, str]:
    """Say what was compared and how well it lies, as HTML by name; "" where nothing is known."""
    dropped = " ".join(dropped_text(side, count) for side, count in dropped_rows(changes).items())
    registration = escape(registration_text(changes) or "")
    doubtful = changes.registration.in_doubt and registration
    counts = point_counts(changes, clouds)
    return {
        "Compared": f"<b><bdi>{escape(names.before)}</bdi></b> ({counts.before:,} points) with "
        f"<b><bdi>{escape(names.after)}</bdi></b> ({counts.after:,} points)",
        "Volume": escape(_sentence(volumes_text(changes), "Volume: ")),
        "Registration": f'<span class="doubt">{registration}</span>' if doubtful else registration,
        "Sensor poses": OPTION.sub(r"<code>\g<0></code>", escape(_sentence(poses_text(changes), "Sensor poses: "))),
        "Not observed": escape(_sentence(unobserved_text(changes), "Not observed ")),
        "Resolution": escape(_resolution(changes)),
        "Left out": escape(dropped),
        "Reference system": escape(system_name(changes.crs or "")),
    }


def _resolution(changes: Changes) -> str:
    """Say how fine the comparison was, where that was recorded."""
    size, finest, tolerance = (_measured(changes, name) for name in ("voxel_size", "finest_voxel_size", "tolerance"))
    texts = []
    if size and finest in (None, size):
        texts.append(f"Compared in voxels of {size}.")
    elif size:
        texts.append(f"Compared in voxels of {finest} to {size}, as small as both scans allow at each place.")
    if tolerance:
        texts.append(f"Registration error up to {tolerance} is tolerated.")
    return " ".join(texts)


def _measured(changes: Changes, name: str) -> str | None:
    value = changes.diagnostics.get(name)
    return length_text(value, changes.unit) if isinstance(value, float) and value > 0 else None


def _details(changes: Changes) -> str:
    diagnostics = {"Earth mover's distance": changes.emd, "registration": changes.registration.to_dict()}
    return f"""<details><summary>Settings and diagnostics</summary>
<div class="details"><section><h2>Settings</h2>{_values_table(changes.config.to_dict())}</section>
<section><h2>Diagnostics</h2>{_values_table(diagnostics | dict(changes.diagnostics))}</section></div></details>"""


def _values_table(value: Any) -> str:
    """Make nested tables of nested plain values; lists of scalars stand on one line."""
    if isinstance(value, Mapping):
        rows = "".join(
            f'<tr><th scope="row">{escape(_readable(str(name)))}</th><td>{_values_table(content)}</td></tr>'
            for name, content in value.items()
        )
        return f'<table class="values">{rows}</table>' if rows else "none"
    if isinstance(value, str) or not isinstance(value, Sequence):
        return escape(_scalar(value))
    if any(isinstance(item, Mapping | list | tuple) for item in value):
        return "".join(f'<div class="item">{_values_table(item)}</div>' for item in value)
    return escape(", ".join(_scalar(item) for item in value)) if value else "none"


def _scalar(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _readable(name: str) -> str:
    words = name.replace("_", " ")
    return words[:1].upper() + words[1:]


def _name(cloud: PointCloud, side: str) -> str:
    return PurePath(cloud.source).name if cloud.source else f"the {side} cloud"


def _sentence(text: str | None, beginning: str) -> str:
    """A sentence without its beginning, which is the heading beside it; empty where there is none."""
    rest = (text or "").removeprefix(beginning)
    return rest[:1].upper() + rest[1:]
