"""The record of a cloud in memory."""

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64, Int64, UInt8

from gmmjax.clouds.coordinates import as_points
from gmmjax.clouds.source_file import FileRows, SourceFile
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError

# What the fields are called that hold how much light came back, in the formats that can be read.
INTENSITY = re.compile(r"(scalar[_ ])?(intensity|reflectance)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points on the host, as read, without the rows that have no position.

    Build one with `PointCloud.from_rows`, which drops and counts the rows with NaN or inf.

    Attributes:
        points: coordinates, all finite, in any unit.
        rows: the row of the source that each point came from, so that results can refer to the source.
        colors: red, green and blue, or None.
        fields: further scalars per point, by name, as read (label, probability, intensity, ...).
        rows_dropped: how many rows of the source had a NaN or infinite coordinate.
        source: the file, or None for arrays.
        views: where the sensor stood, in the frame of the points, where the file says so; else None.
        unit: of the coordinates, such as "m", where the file says so, or "degree" or "angle" where x and y are angles;
            else None.
        crs: coordinate reference system of the points, as "EPSG:25832" or else as WKT, where the file says so; else
            None.
        file: what `read_cloud` read, so that a result can be written with all that it held; else None.
        files: what `read_survey` read, one after the other, where it was several files; else empty.

    Raises:
        InputError: arrays whose shapes or types disagree with the above.
    """

    points: Float64[np.ndarray, "n 3"]
    rows: Int64[np.ndarray, " n"]
    colors: UInt8[np.ndarray, "n 3"] | None = None
    fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    rows_dropped: int = 0
    source: str | None = None
    views: SensorViews | None = None
    unit: str | None = None
    crs: str | None = None
    file: SourceFile | None = None
    files: tuple[FileRows, ...] = ()

    def __post_init__(self) -> None:
        prefix = _prefix(self.source)
        if self.points.dtype != np.float64 or not np.isfinite(as_points(self.points, f"{prefix}points")).all():
            raise InputError(f"{prefix}points must be finite float64 [N, 3]; build the cloud with PointCloud.from_rows")
        if self.rows.dtype != np.int64 or self.rows.shape != (len(self),):
            raise InputError(f"{prefix}rows must be int64 [{len(self)}], one for each point, not {_kind(self.rows)}")
        _check_attributes(self.colors, self.fields, len(self), prefix)

    def __len__(self) -> int:
        """The number of points."""
        return int(self.points.shape[0])

    def __repr__(self) -> str:
        parts = [f"{len(self):,} points"]
        parts += ["colours"] if self.colors is not None else []
        parts += [f"fields {', '.join(map(repr, self.fields))}"] if self.fields else []
        parts += [f"{self.rows_dropped:,} rows dropped"] if self.rows_dropped else []
        parts += [f"{len(self.views)} views"] if self.views is not None else []
        parts += [f"{len(self.files)} files"] if self.files else []
        return f"<PointCloud: {', '.join(parts)}{'' if self.source is None else f'; {self.source!r}'}>"

    @classmethod
    def from_rows(
        cls,
        points: npt.ArrayLike,
        colors: npt.ArrayLike | None = None,
        fields: Mapping[str, npt.ArrayLike] | None = None,
        source: str | None = None,
        views: SensorViews | None = None,
    ) -> "PointCloud":
        """Make a cloud of those rows whose three coordinates are finite.

        Args:
            points: real coordinates [N, 3], in any unit.
            colors: red, green and blue [N, 3], uint8.
            fields: scalars [N] by name.
            source: the file that the rows came from, for messages.
            views: where the sensor stood, in the frame of the points; None where that is not known.

        Raises:
            InputError: a shape or type that does not fit.
        """
        prefix = _prefix(source)
        coordinates = as_points(points, f"{prefix}points")
        color_rows = None if colors is None else np.asarray(colors)
        columns = {name: np.asarray(values) for name, values in (fields or {}).items()}
        _check_attributes(color_rows, columns, len(coordinates), prefix)
        finite = np.isfinite(coordinates).all(axis=1)
        rows = np.flatnonzero(finite).astype(np.int64, copy=False)
        if len(rows) < len(coordinates):
            coordinates = coordinates[rows]
            color_rows = None if color_rows is None else color_rows[rows]
            columns = {name: values[rows] for name, values in columns.items()}
        return cls(coordinates, rows, color_rows, columns, int(len(finite) - len(rows)), source, views)

    def by_file(self) -> Iterator[tuple[slice, "PointCloud"]]:
        """Yield the points of each of the `files`, with its own rows, colours and fields, and where they are here.

        Points, values and their number may have been changed since they were read; the rows must be ascending.
        """
        for own in self.files:
            place = slice(*map(int, np.searchsorted(self.rows, own.rows)))
            part = self.part(place)
            fields = {name: part.fields[name].astype(kind) for name, kind in own.fields if name in part.fields}
            yield (
                place,
                dataclasses.replace(
                    part,
                    rows=part.rows - own.rows[0],
                    colors=part.colors if own.colored else None,
                    fields=fields,
                    rows_dropped=own.rows[1] - own.rows[0] - len(part),
                    source=str(own.file.path),
                    views=None,
                    file=own.file,
                    files=(),
                ),
            )

    def part(self, place: slice | np.ndarray) -> "PointCloud":
        """Some of the points, in their order."""
        return dataclasses.replace(
            self,
            points=self.points[place],
            rows=self.rows[place],
            colors=None if self.colors is None else self.colors[place],
            fields={name: values[place] for name, values in self.fields.items()},
        )


def intensity_field(names: Iterable[str]) -> str | None:
    """The name, among those of all fields, of the intensity of the scanner's returns; None where there is none."""
    return next(filter(INTENSITY.fullmatch, names), None)


def _check_attributes(colors: np.ndarray | None, fields: Mapping[str, np.ndarray], count: int, prefix: str) -> None:
    if colors is not None and (colors.dtype != np.uint8 or colors.shape != (count, 3)):
        raise InputError(f"{prefix}colors must be uint8 [{count}, 3], one for each point, not {_kind(colors)}")
    for name, values in fields.items():
        if values.dtype.kind not in "fiub" or values.shape != (count,):
            raise InputError(
                f"{prefix}field {name!r} must be numbers [{count}], one for each point, not {_kind(values)}"
            )


def _kind(array: np.ndarray) -> str:
    return f"{array.dtype} {list(array.shape)}"


def _prefix(source: str | None) -> str:
    return "" if source is None else f"{source}: "
