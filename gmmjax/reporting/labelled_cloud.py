"""A scan with what was found about each of its points, in the format of its file and with all that the file held."""

import dataclasses
import functools
import itertools
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.changes import NAMES, Changes
from gmmjax.clouds import (
    CHUNK_POINTS,
    EXTRA_TYPES,
    CloudFile,
    LasPart,
    LasSource,
    PcdForm,
    PointCloud,
    SourceFile,
    SurveyFiles,
    copied_part,
    read_layout,
    viewpoint_of,
    write_las,
    write_las_blocks,
    write_pcd_parts,
    write_ply_parts,
)
from gmmjax.errors import InputError, warn
from gmmjax.geometry import transformed
from gmmjax.pair import Pair, each
from gmmjax.reporting.palette import point_colors
from gmmjax.reporting.written_fields import written_fields

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
COMMENT = "written by gmmjax detect: label is -1 where unchanged, else the index of the change in changes.json"
# Whole numbers up to here are exact in float64.
EXACT = 2**53
# PLY's largest whole number.
LARGEST_INT = 2**31 - 1


@dataclasses.dataclass(frozen=True, eq=False)
class LabelledCloud:
    """A scan of a result, in memory or in its file; one in its file is read and written some points at a time.

    Attributes:
        cloud: as it was given, or the file that it is in.
        found: what was found, by name, about each point of a cloud, or about each row of a file, also those without a
            position. Arrays or memory maps.
        transform: takes it to where it is written; None: it is written where it is.
    """

    cloud: PointCloud | CloudFile
    found: Mapping[str, np.ndarray]
    transform: Float64[np.ndarray, "4 4"] | None

    @property
    def file(self) -> SourceFile | None:
        """The file that the scan was read from."""
        return self.cloud.file if isinstance(self.cloud, PointCloud) else self.cloud.source

    @property
    def points(self) -> int:
        """The number of points with a position."""
        return len(self.cloud) if isinstance(self.cloud, PointCloud) else self.cloud.measures.points

    @property
    def rows(self) -> int:
        """The number of rows, among them those without a position."""
        cloud = self.cloud
        return len(cloud) + cloud.rows_dropped if isinstance(cloud, PointCloud) else cloud.count

    def placed(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Move points of the scan to where they are written."""
        return points if self.transform is None else transformed(points, self.transform)

    def found_in(self, rows: Int64[np.ndarray, " n"]) -> dict[str, np.ndarray]:
        """Return what was found about rows of the file, which ascend."""
        first, last = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 0)
        values = {name: copied_part(own, first, last) for name, own in self.found.items()}
        return values if last - first == len(rows) else {name: own[rows - first] for name, own in values.items()}

    def parts(self, reserved: tuple[str, ...] = (), as_floats: Collection[str] = ()) -> Iterator[PointCloud]:
        """Yield the scan as it is written, some points at a time.

        The colours are those of the kinds of change, or the scan's own where no kinds were found; fields are as of
        `written_fields`, with `reserved` names that no field must have. Those of the scan `as_floats` become float64.
        """
        for scan, found in self._scans():
            fields = {name: own.astype(float) if name in as_floats else own for name, own in scan.fields.items()}
            scan = dataclasses.replace(scan, fields=fields)
            yield dataclasses.replace(
                scan,
                points=self.placed(scan.points),
                colors=point_colors(found["kind"], scan.colors) if "kind" in found else scan.colors,
                fields=written_fields(scan, found, reserved, self.transform),
            )

    def _scans(self) -> Iterator[tuple[PointCloud, dict[str, np.ndarray]]]:
        """Yield the scan as it was given, some points at a time, with what was found about them."""
        if isinstance(self.cloud, PointCloud):
            for start in range(0, len(self.cloud), CHUNK_POINTS):
                place = slice(start, start + CHUNK_POINTS)
                yield self.cloud.part(place), {name: values[place] for name, values in self.found.items()}
        else:
            yield from ((cloud, self.found_in(cloud.rows)) for cloud in self.cloud.clouds())

    def by_file(self) -> "list[LabelledCloud]":
        """Return each scan of a survey in memory that was read from several files; any other cloud as it is."""
        if not isinstance(self.cloud, PointCloud) or not self.cloud.files:
            return [self]
        return [
            LabelledCloud(cloud, {name: values[place] for name, values in self.found.items()}, self.transform)
            for place, cloud in self.cloud.by_file()
        ]

    @property
    def ending(self) -> str:
        """The ending of the file that is written."""
        if self.file is None or self.file.ending not in WRITERS:
            return ".ply"
        return LasSource.of(self.file).ending if WRITERS[self.file.ending] is _write_las else self.file.ending

    def write(self, folder: Path, stem: str) -> str:
        """Write it in the format of its file where that is LAS, LAZ or PCD, else as PLY, and return the file's name.

        Raises:
            InputError, OSError: the file cannot be written.

        Warns:
            InputWarning: what the scan was read from cannot be read again; it is written as PLY.
        """
        source = self.file
        writer = None if source is None else WRITERS.get(source.ending)
        if writer is not None:
            try:
                return writer(self, folder, stem)
            except InputError as error:
                warn(f"{error}; {stem}.ply is written in place of {stem}{source.ending if source else ''}")
        return _write_ply(self, folder, stem)


def labelled_clouds(
    clouds: Pair[PointCloud], changes: Changes, transform_after: Float64[np.ndarray, "4 4"] | None = None
) -> Pair[LabelledCloud]:
    """Put what was found beside both scans as they were given; `transform_after` moves the after scan."""
    return each(
        lambda cloud, side, transform: _labelled(cloud, changes.point_values(side), transform),
        clouds,
        NAMES,
        Pair(None, transform_after),
    )


def _labelled(cloud: PointCloud, values: Mapping[str, np.ndarray], transform: np.ndarray | None) -> LabelledCloud:
    # Files of points have no truth values.
    return LabelledCloud(cloud, {**values, "unobserved": values["unobserved"].astype(np.uint8)}, transform)


def labelled_files(
    survey: SurveyFiles, found: Mapping[str, np.ndarray], transform: Float64[np.ndarray, "4 4"] | None
) -> list[LabelledCloud]:
    """Put what was found about each row of a survey beside each of its files; arrays or memory maps."""
    return [
        LabelledCloud(file, {name: values[survey.rows_of(index)] for name, values in found.items()}, transform)
        for index, file in enumerate(survey.files)
    ]


def write_scan(
    path: str | os.PathLike[str],
    scan: CloudFile,
    columns: Mapping[str, np.ndarray],
    transform: Float64[np.ndarray, "4 4"] | None = None,
) -> Path:
    """Write a scan of any size with further values of each point: what `gmmjax detect` does with labels.

    LAS, LAZ and PCD stay what they are, with all that the file holds, as in a result; all others become PLY.

    Args:
        path: the file to write; a file that is there is replaced.
        scan: from `open_cloud`.
        columns: values of each row of the file by name, numbers of 8 to 64 bits. Arrays or memory maps.
        transform: where the points are written; None: where they are.

    Returns:
        The path.

    Raises:
        InputError: the path has another ending than the format; columns that are not numbers for each row; the scan was
            changed or is damaged; the file cannot be written, as on a full disk, and is then as it was.
    """
    file = Path(path)
    for name, values in columns.items():
        if values.shape != (scan.count,) or values.dtype.str[1:] not in EXTRA_TYPES:
            raise InputError(
                f"column {name!r} must be whole or real numbers [{scan.count}], one for each row of {scan.path}, not "
                f"{values.dtype} {list(values.shape)}"
            )
    labelled = LabelledCloud(scan, columns, transform)
    if file.suffix != (ending := labelled.ending):
        raise InputError(f"{file}: a result of {scan.path.name} is a {ending} file; name it {file.stem}{ending}")
    try:
        WRITERS.get(scan.source.ending, _write_ply)(labelled, file.parent, file.stem)
    except OSError as error:
        raise InputError(
            f"{file}: cannot be written ({error.strerror or error}); free some space or choose another folder"
        ) from error
    return file


def write_scans(folder: Path, side: str, scans: Sequence[LabelledCloud]) -> list[str]:
    """Write a scan as a file `side`, or those of a survey of several as files of their own names in a folder `side`.

    Returns:
        The names of the files.

    Raises:
        InputError, OSError: a file cannot be written.

    Warns:
        InputWarning: as `LabelledCloud.write`.
    """
    if len(scans) == 1:
        return [scans[0].write(folder, side)]
    (folder / side).mkdir()
    names, taken = [], set[str]()
    for scan in scans:
        assert scan.file is not None
        stem = _free_stem(scan.file.path.stem, taken)
        taken.add(stem.lower())
        names.append(f"{side}/{scan.write(folder / side, stem)}")
    return names


def _free_stem(stem: str, taken: set[str]) -> str:
    """Return the stem, with a number where it is taken: some file systems do not tell upper from lower case."""
    candidates = itertools.chain([stem], (f"{stem}-{number}" for number in itertools.count(2)))
    return next(name for name in candidates if name.lower() not in taken)


def _write_ply(labelled: LabelledCloud, folder: Path, stem: str) -> str:
    with_rows = labelled.points < labelled.rows
    parts = labelled.parts(("row",) if with_rows else (), _beyond_ply(labelled))
    comments = [COMMENT] if "label" in labelled.found else []
    ordered = (_with_row(part, labelled) for part in parts) if with_rows else parts
    write_ply_parts(folder / f"{stem}.ply", ordered, labelled.points, comments)
    return f"{stem}.ply"


def _with_row(part: PointCloud, labelled: LabelledCloud) -> PointCloud:
    """Add the row of the file of each point, between what was found and the fields of the scan."""
    rows = part.rows if labelled.rows <= LARGEST_INT else part.rows.astype(np.float64)
    found = {name: part.fields[name] for name in labelled.found}
    return dataclasses.replace(part, fields={**found, "row": rows, **part.fields})


def _write_pcd(labelled: LabelledCloud, folder: Path, stem: str) -> str:
    assert labelled.file is not None
    labelled.file.require_unchanged()
    layout = read_layout(labelled.file.path)
    transform = labelled.transform
    with_rows = labelled.points < labelled.rows and layout.grid is None
    form = PcdForm(
        shape=(labelled.points,) if layout.grid is None else layout.grid,
        viewpoint=layout.viewpoint if transform is None else viewpoint_of(transform @ layout.pose),
        dtype=layout.dtype if layout.dtype.kind == "f" else np.dtype(np.float64),
        empty={"label": -1},
    )
    parts = (
        dataclasses.replace(part, fields={"row": part.rows, **part.fields} if with_rows else part.fields)
        for part in labelled.parts(("row",) if with_rows else ())
    )
    write_pcd_parts(folder / f"{stem}.pcd", parts, form)
    return f"{stem}.pcd"


def _write_las(labelled: LabelledCloud, folder: Path, stem: str) -> str:
    assert labelled.file is not None
    source, cloud = LasSource.of(labelled.file), labelled.cloud
    name = f"{stem}{source.ending}"
    if isinstance(cloud, PointCloud):
        placed = dataclasses.replace(cloud, points=labelled.placed(cloud.points))
        write_las(folder / name, source, placed, labelled.found, _described(labelled))
        return name

    part_of = functools.partial(_las_part, labelled)
    described = {own: (labelled.found[own].dtype, text) for own, text in _described(labelled).items()}
    write_las_blocks(folder / name, source, part_of, described)
    return name


def _las_part(labelled: LabelledCloud, first: int, coordinates: Float64[np.ndarray, "n 3"]) -> LasPart:
    rows = np.flatnonzero(np.isfinite(coordinates).all(axis=1))
    return LasPart(rows, labelled.placed(coordinates[rows]), labelled.found_in(first + rows))


def _described(labelled: LabelledCloud) -> dict[str, str]:
    """Describe each of the values that were found."""
    return {name: DESCRIPTIONS.get(name, "") for name in labelled.found}


WRITERS: Mapping[str, Callable[[LabelledCloud, Path, str], str]] = {
    ".las": _write_las,
    ".laz": _write_las,
    ".pcd": _write_pcd,
}
ENDINGS = (".ply", *WRITERS)


def _beyond_ply(labelled: LabelledCloud) -> set[str]:
    """Name the scan's fields that PLY has no type for; they become float64, which holds whole numbers of 53 bits."""
    cloud = labelled.cloud
    fields = (cloud if isinstance(cloud, PointCloud) else next(cloud.clouds(1))).fields
    ranges = _ranges(cloud) if isinstance(cloud, PointCloud) else cloud.measures.whole
    beyond = {name: own for name, own in ranges.items() if min(own) < -LARGEST_INT - 1 or max(own) > LARGEST_INT}
    for name, (low, high) in beyond.items():
        if max(-low, high) > EXACT:
            source = cloud.source if isinstance(cloud, PointCloud) else cloud.path
            warn(
                f"{source}: field {name!r} runs from {low} to {high}, beyond PLY's numbers; it is rounded to float64 "
                "in the result"
            )
    return {*beyond, *(name for name, own in fields.items() if own.dtype.kind == "f" and own.dtype.itemsize > 8)}


def _ranges(cloud: PointCloud) -> dict[str, tuple[int, int]]:
    """Return the lowest and highest value of each field of whole numbers of 64 bits."""
    long = {name: own for name, own in cloud.fields.items() if own.dtype.kind in "iu" and own.dtype.itemsize == 8}
    return {name: (int(own.min()), int(own.max())) for name, own in long.items() if own.size}
