"""Several scans of one survey, each in a file of its own, as one cloud."""

import dataclasses
import functools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int64, UInt8

from gmmjax.clouds.cloud_file import CHUNK_POINTS, CloudChunk, CloudFile
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.reading import open_cloud, read_opened
from gmmjax.clouds.reference_system import ANGLES, epsg_code
from gmmjax.clouds.source_file import FileRows
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError, warn

# What a point of a file without colours has beside those of a file with colours: the middle of the range.
NO_COLOR = 128
# Files of a survey whose names are all in its title.
MAX_NAMES = 3


@dataclasses.dataclass(frozen=True, eq=False)
class SurveyFiles:
    """The files of one survey, in one frame and one unit; its rows are those of the files, one after the other.

    Attributes:
        files: at least one.

    Raises:
        InputError: no file, a file that is given twice, or files that state two units or reference systems.
    """

    files: tuple[CloudFile, ...]

    def __post_init__(self) -> None:
        if not self.files:
            raise InputError("a survey needs at least one file")
        known: set[Path] = set()
        for file in self.files:
            if (place := Path(os.path.realpath(file.path))) in known:
                raise InputError(f"{file.path}: is given twice as a scan of one survey; give each file once")
            known.add(place)
        _check_stated(
            self.files,
            lambda file: file.unit,
            "the scans of a survey must be in one unit; convert one of them",
        )
        _check_stated(
            self.files,
            lambda file: epsg_code(file.crs),
            "the scans of a survey must be in one coordinate reference system; reproject one of them (such as with "
            "pdal translate and filters.reprojection)",
        )

    @property
    def count(self) -> int:
        """Rows of all files, among them those without a position."""
        return sum(file.count for file in self.files)

    @property
    def unit(self) -> str | None:
        """Unit of the coordinates, where all files state it; angles, where any of them does."""
        stated = {file.unit for file in self.files}
        return next((unit for unit in ANGLES if unit in stated), stated.pop() if len(stated) == 1 else None)

    @property
    def crs(self) -> str | None:
        """Coordinate reference system, where all files state it."""
        return self.files[0].crs if len({file.crs for file in self.files}) == 1 else None

    @functools.cached_property
    def views(self) -> SensorViews | None:
        """The scanners' views, where all files have them; files may have to be read for that, once.

        Warns:
            InputWarning: only some of them say so, and it is not used.
        """
        return self._merged([file.views for file in self.files])

    def rows_of(self, index: int) -> slice:
        """The rows of a file among those of the survey.

        Args:
            index: of the file.
        """
        start = sum(file.count for file in self.files[:index])
        return slice(start, start + self.files[index].count)

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[CloudChunk]:
        """The points of all files that have a position, at most `size` at a time; rows are the survey's.

        Args:
            size: points.

        Raises:
            InputError: as `CloudFile.row_blocks`.
        """
        for index, file in enumerate(self.files):
            start = self.rows_of(index).start
            for points, rows in file.chunks(size):
                yield CloudChunk(points, rows + start)

    def colors_or_intensity(self, rows: Int64[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"] | np.ndarray | None:
        """The colours of some rows, grey where a file has none; if none has any their intensity, NaN where it has none.

        Args:
            rows: of the survey, as of `CloudFile.colors_or_intensity`.

        Returns:
            Red, green and blue [n, 3], or the intensity [n]; None where no file has either.

        Raises:
            InputError: as `CloudFile.colors_or_intensity`.
        """
        places, found = [], []
        for index, file in enumerate(self.files):
            own = self.rows_of(index)
            places.append((rows >= own.start) & (rows < own.stop))
            found.append(file.colors_or_intensity(rows[places[-1]] - own.start))
        known = [values for values in found if values is not None]
        if not known:
            return None
        colored = any(values.ndim == 2 for values in known)
        joined = np.full((len(rows), 3), NO_COLOR, np.uint8) if colored else np.full(len(rows), np.nan)
        for place, values in zip(places, found, strict=True):
            if values is not None and values.ndim == joined.ndim:
                joined[place] = values
        return joined

    def read(self) -> PointCloud:
        """All points, in memory; colours are grey, and fields NaN, where a file has none and another one has.

        Raises:
            InputError: as `CloudFile.row_blocks`, or a file has no finite point.

        Warns:
            InputWarning: as `views`.
        """
        clouds = [read_opened(file) for file in self.files]
        if len(clouds) == 1:
            return clouds[0]
        places = [self.rows_of(index) for index in range(len(clouds))]
        return PointCloud(
            np.concatenate([cloud.points for cloud in clouds]),
            np.concatenate([cloud.rows + place.start for cloud, place in zip(clouds, places, strict=True)]),
            _joined_colors(clouds),
            _joined_fields(clouds),
            sum(cloud.rows_dropped for cloud in clouds),
            self.title,
            self._merged([cloud.views for cloud in clouds]),
            self.unit,
            self.crs,
            files=tuple(_file_rows(*own) for own in zip(self.files, clouds, places, strict=True)),
        )

    @property
    def title(self) -> str:
        """The names of the files, without their folders."""
        names = [file.path.name for file in self.files]
        return ", ".join(names) if len(names) <= MAX_NAMES else f"{names[0]} and {len(names) - 1} more files"

    def _merged(self, known: Sequence[SensorViews | None]) -> SensorViews | None:
        """The views of all files together."""
        stated = [views for views in known if views is not None]
        if len(stated) == len(known):
            return SensorViews.merged(stated)
        if stated:
            silent = self.files[list(known).index(None)].path
            warn(
                f"{silent}: does not say where the scanner stood, as other scans of its survey do; none of these "
                "positions is used. Give the positions of all scans"
            )
        return None


def open_survey(paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> SurveyFiles:
    """The scans of one survey, opened as `open_cloud` does.

    Args:
        paths: of the files, or of the only one; they are in one frame and one unit.

    Raises:
        InputError: as `open_cloud`; no file, one that is given twice, or files that state two units or reference
            systems.
    """
    several = [paths] if isinstance(paths, str | os.PathLike) else paths
    return SurveyFiles(tuple(open_cloud(path) for path in several))


def read_survey(paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> PointCloud:
    """The scans of one survey as one cloud, read as `read_cloud` does; its rows are those of the files in their order.

    Each scan of a result of it is written by itself. `PointCloud.by_file` gives the points of each file.

    Args:
        paths: of the files, or of the only one; they are in one frame and one unit.

    Returns:
        The cloud; where there is one file, as `read_cloud`. It has views where all files say where the scanner stood.

    Raises:
        InputError: as `read_cloud` and `open_survey`.

    Warns:
        InputWarning: only some files say where the scanner stood, and it is not used.
    """
    return open_survey(paths).read()


def _joined_colors(clouds: Sequence[PointCloud]) -> UInt8[np.ndarray, "n 3"] | None:
    if all(cloud.colors is None for cloud in clouds):
        return None
    return np.concatenate(
        [np.full((len(cloud), 3), NO_COLOR, np.uint8) if cloud.colors is None else cloud.colors for cloud in clouds]
    )


def _joined_fields(clouds: Sequence[PointCloud]) -> dict[str, np.ndarray]:
    names = dict.fromkeys(name for cloud in clouds for name in cloud.fields)
    return {
        name: np.concatenate([cloud.fields.get(name, np.full(len(cloud), np.nan)) for cloud in clouds])
        for name in names
    }


def _file_rows(file: CloudFile, cloud: PointCloud, place: slice) -> FileRows:
    fields = tuple((name, values.dtype.str) for name, values in cloud.fields.items())
    return FileRows(file.source, (place.start, place.stop), fields, cloud.colors is not None)


def _check_stated(files: Sequence[CloudFile], stated: Callable[[CloudFile], str | None], remedy: str) -> None:
    """Check that all files that state something state the same."""
    known = [(file, stated(file)) for file in files if stated(file) is not None]
    for file, value in known:
        first, expected = known[0]
        if value != expected:
            raise InputError(f"{file.path}: is in {value}, and {first.path} in {expected}, as they state: {remedy}")
