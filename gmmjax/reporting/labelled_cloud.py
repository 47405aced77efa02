"""A scan with what was found about each of its points, in the format of its file and with all that the file held."""

import dataclasses
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import get_args

import numpy as np
from jaxtyping import Float64

from gmmjax.changes import OPTIONAL_FIGURES, Changes, Kind
from gmmjax.clouds import (
    AXES,
    LasSource,
    PointCloud,
    free_name,
    read_layout,
    viewpoint_of,
    write_las,
    write_pcd,
    write_ply,
)
from gmmjax.errors import InputError, warn
from gmmjax.geometry import transformed
from gmmjax.pair import Pair
from gmmjax.reporting.palette import point_colors

CHANNELS = ("red", "green", "blue")
# What is found about a point, as LAS describes its dimensions: in at most 32 letters.
DESCRIPTIONS: Mapping[str, str] = {
    "label": "change in changes.json, or -1",
    "kind": "1 appeared 2 disappeared 3 moved",
    "probability": "of belonging to a change",
    "unobserved": "not observed by the other survey",
    "distance": "signed distance to other surface",
    "level_of_detection": "distance significant at 95 %",
    "significance": "distance in standard errors",
}
# Names of the components of a normal, of the writers of PLY and of the Point Cloud Library.
NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
COMMENT = "written by gmmjax detect: label is -1 where unchanged, else the index of the change in changes.json"
# Whole numbers up to here are exact in float64.
EXACT = 2**53


@dataclasses.dataclass(frozen=True, eq=False)
class LabelledCloud:
    """A scan of a result.

    Attributes:
        cloud: as it was given.
        found: what was found about each of its points, by the names of `DESCRIPTIONS`.
        colors: of each point: the colour of its kind of change, or its own, half way to grey.
        transform: takes it into the frame of the before cloud; None: it is in it.
    """

    cloud: PointCloud
    found: Mapping[str, np.ndarray]
    colors: np.ndarray
    transform: Float64[np.ndarray, "4 4"] | None

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        """In the frame of the before cloud."""
        return self.cloud.points if self.transform is None else transformed(self.cloud.points, self.transform)

    def fields(self, reserved: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
        """What was found, the scan's own colours as `scan_red` and so on, and its fields, normals turned with it.

        A field of the scan with the name of another one of these becomes `input_NAME`.

        Args:
            reserved: further names that a field must not have.
        """
        fields = dict(self.found)
        if self.cloud.colors is not None:
            fields |= {f"scan_{channel}": self.cloud.colors[:, index] for index, channel in enumerate(CHANNELS)}
        own = _turned(self.cloud.fields, self.transform)
        for name, values in own.items():
            plain = _plain(name)
            taken = {*fields, *reserved, *AXES, *CHANNELS, "rgb", "rgba"}
            fields[free_name(plain, {*taken, *own}) if plain in taken else plain] = values
        return fields

    def write(self, folder: Path, stem: str) -> str:
        """Writes it in the format of its file where that is LAS, LAZ or PCD, else as PLY.

        Args:
            folder: that is there.
            stem: the name of the file without its ending.

        Returns:
            The name of the file.

        Raises:
            InputError, OSError: the file cannot be written.

        Warns:
            InputWarning: what the scan was read from cannot be read again; it is written as PLY.
        """
        source = self.cloud.file
        writer = None if source is None else WRITERS.get(source.ending)
        if writer is not None:
            try:
                return writer(self, folder, stem)
            except InputError as error:
                warn(f"{error}; {stem}.ply is written in place of {stem}{source.ending if source else ''}")
        return _write_ply(self, folder, stem)


def labelled_clouds(clouds: Pair[PointCloud], changes: Changes) -> Pair[LabelledCloud]:
    """Both scans with what was found about their points.

    Args:
        clouds: as they were given.
        changes: what was found between them.
    """
    numbers = np.array([0, *(get_args(Kind).index(change.kind) + 1 for change in changes.items)], np.uint8)

    def labelled(cloud: PointCloud, side: str, transform: np.ndarray | None) -> LabelledCloud:
        labels = getattr(changes, f"labels_{side}")
        found = {
            "label": labels.astype(np.int32),
            "kind": numbers[labels + 1],
            "probability": getattr(changes, f"probability_{side}").astype(np.float32),
            "unobserved": getattr(changes, f"unobserved_{side}").astype(np.uint8),
        }
        figures = {name: getattr(changes, f"{name}_{side}") for name in OPTIONAL_FIGURES}
        found |= {name: values.astype(np.float32) for name, values in figures.items() if values is not None}
        return LabelledCloud(cloud, found, point_colors(labels, changes, cloud.colors), transform)

    registration = changes.registration
    transform = registration.transform if registration.applied else None
    return Pair(labelled(clouds.before, "before", None), labelled(clouds.after, "after", transform))


def _write_ply(labelled: LabelledCloud, folder: Path, stem: str) -> str:
    rows = {"row": labelled.cloud.rows} if labelled.cloud.rows_dropped else {}
    fields = labelled.fields(tuple(rows))
    # The row stands beside what was found, before the fields of the scan.
    ordered = {**{name: fields[name] for name in labelled.found}, **rows, **fields}
    stored = {name: _for_ply(values, f"{labelled.cloud.source}: field {name!r}") for name, values in ordered.items()}
    name = f"{stem}.ply"
    write_ply(folder / name, labelled.points, colors=labelled.colors, fields=stored, comments=[COMMENT])
    return name


def _write_pcd(labelled: LabelledCloud, folder: Path, stem: str) -> str:
    cloud = labelled.cloud
    assert cloud.file is not None
    cloud.file.require_unchanged()
    layout = read_layout(cloud.file.path)
    pose = np.eye(4) if layout.pose is None else layout.pose
    moved = pose if labelled.transform is None else labelled.transform @ pose
    points = labelled.points.astype(layout.dtype if layout.dtype.kind == "f" else np.float64)
    rows = {"row": cloud.rows} if cloud.rows_dropped and layout.grid is None else {}
    columns = {"points": points, "colors": labelled.colors} | {
        f"field {name}": values for name, values in {**rows, **labelled.fields(tuple(rows))}.items()
    }
    if layout.grid is not None:
        columns = {name: _by_pixel(values, cloud.rows, layout.grid, name) for name, values in columns.items()}
    fields = {name.removeprefix("field "): values for name, values in columns.items() if name.startswith("field ")}
    write_pcd(
        folder / f"{stem}.pcd",
        columns["points"],
        viewpoint=viewpoint_of(moved),
        colors=columns["colors"],
        fields=fields,
    )
    return f"{stem}.pcd"


def _write_las(labelled: LabelledCloud, folder: Path, stem: str) -> str:
    cloud = labelled.cloud
    assert cloud.file is not None
    source = LasSource.of(cloud.file)
    name = f"{stem}{source.ending}"
    placed = cloud if labelled.transform is None else dataclasses.replace(cloud, points=labelled.points)
    write_las(folder / name, source, placed, labelled.found, DESCRIPTIONS)
    return name


WRITERS: Mapping[str, Callable[[LabelledCloud, Path, str], str]] = {
    ".las": _write_las,
    ".laz": _write_las,
    ".pcd": _write_pcd,
}
ENDINGS = (".ply", *WRITERS)


def _turned(fields: Mapping[str, np.ndarray], transform: np.ndarray | None) -> dict[str, np.ndarray]:
    """The fields, in their order; normals turned as the points are."""
    turned = dict(fields)
    for names in NORMALS if transform is not None else ():
        if all(name in fields and fields[name].dtype.kind == "f" for name in names):
            assert transform is not None
            normals = np.stack([fields[name] for name in names], axis=1) @ transform[:3, :3].T
            turned |= {name: normals[:, axis].astype(fields[name].dtype) for axis, name in enumerate(names)}
    return turned


def _plain(name: str) -> str:
    """A name that PLY and PCD can have: of letters, digits, dots, - and _, with a letter in front."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name)
    return plain if re.match(r"[A-Za-z]", plain) else f"field_{plain}"


def _for_ply(values: np.ndarray, name: str) -> np.ndarray:
    """The values in a type that PLY has: whole numbers beyond 32 bits as float64, which holds 53 of them."""
    limits = np.iinfo(np.int32)
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8 and values.size:
        low, high = int(values.min()), int(values.max())
        if max(-low, high) > EXACT:
            warn(f"{name} runs from {low} to {high}, beyond PLY's numbers; it is rounded to float64 in the result")
        return values if limits.min <= low and high <= limits.max else values.astype(np.float64)
    return values.astype(np.float64) if values.dtype.kind == "f" and values.dtype.itemsize > 8 else values


def _by_pixel(values: np.ndarray, rows: np.ndarray, grid: tuple[int, int], name: str) -> np.ndarray:
    """Values of the points in the order of the image's pixels; those without a return have NaN, -1 as label, or 0."""
    empty = np.nan if values.dtype.kind == "f" else -1 if name == "field label" else 0
    image = np.full((grid[0] * grid[1], *values.shape[1:]), empty, values.dtype)
    image[rows] = values
    return image.reshape(*grid, *values.shape[1:])
