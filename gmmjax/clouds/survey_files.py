"""Several scans of one survey, each in a file of its own, as one cloud."""

import dataclasses
import functools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from gmmjax.clouds.cloud_file import CHUNK_POINTS, Bounds, CloudChunk, CloudFile
from gmmjax.clouds.reading import open_cloud
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError, warn


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
            lambda file: file.crs,
            "the scans of a survey must be in one coordinate reference system; reproject one of them (such as with "
            "pdal translate and filters.reprojection)",
        )

    @property
    def count(self) -> int:
        """Rows of all files, among them those without a position."""
        return sum(file.count for file in self.files)

    @property
    def bounds(self) -> Bounds | None:
        """Of the points, where all files declare them."""
        known = [file.bounds for file in self.files if file.bounds is not None]
        if len(known) < len(self.files):
            return None
        lowers, uppers = zip(*known, strict=True)
        return Bounds(np.min(lowers, axis=0), np.max(uppers, axis=0))

    @property
    def scans(self) -> int:
        """How many scans there are in all files together."""
        return sum(file.scans for file in self.files)

    @property
    def unit(self) -> str | None:
        """Of the coordinates, where all files state it."""
        return self.files[0].unit if len({file.unit for file in self.files}) == 1 else None

    @property
    def crs(self) -> str | None:
        """Coordinate reference system, where all files state it."""
        return self.files[0].crs if len({file.crs for file in self.files}) == 1 else None

    @functools.cached_property
    def views(self) -> SensorViews | None:
        """Where the scanners stood, where all files say so; files may have to be read for that, once.

        Warns:
            InputWarning: only some of them say so, and it is not used.
        """
        known = [file.views for file in self.files]
        stated = [views for views in known if views is not None]
        if len(stated) == len(known):
            return SensorViews.merged(stated)
        if stated:
            silent = self.files[known.index(None)].path
            warn(
                f"{silent}: does not say where the scanner stood, as other scans of its survey do; none of these "
                "positions is used. Give the positions of all scans"
            )
        return None

    def rows_of(self, index: int) -> slice:
        """The rows of a file among those of the survey.

        Args:
            index: of the file.
        """
        start = sum(file.count for file in self.files[:index])
        return slice(start, start + self.files[index].count)

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[CloudChunk]:
        """The points of all files that have a position, at most `size` at a time; rows and scans are the survey's.

        Args:
            size: points.

        Raises:
            InputError: as `CloudFile.row_blocks`.
        """
        scans = 0
        for index, file in enumerate(self.files):
            start = self.rows_of(index).start
            for points, rows, scan in file.chunks(size):
                if self.scans > 1:
                    scan = np.full(len(rows), scans, np.int16) if scan is None else scan + np.int16(scans)
                yield CloudChunk(points, rows + start, scan)
            scans += file.scans


def open_survey(paths: Sequence[str | os.PathLike[str]]) -> SurveyFiles:
    """The scans of one survey, opened as `open_cloud` does.

    Args:
        paths: of the files; they are in one frame and one unit.

    Raises:
        InputError: as `open_cloud`; no file, one that is given twice, or files that state two units or reference
            systems.
    """
    return SurveyFiles(tuple(open_cloud(path) for path in paths))


def _check_stated(files: Sequence[CloudFile], stated: Callable[[CloudFile], str | None], remedy: str) -> None:
    """Whether all files that state something state the same."""
    known = [(file, stated(file)) for file in files if stated(file) is not None]
    for file, value in known:
        first, expected = known[0]
        if value != expected:
            raise InputError(f"{file.path}: is in {value}, and {first.path} in {expected}, as they state: {remedy}")
