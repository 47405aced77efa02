"""Pairs of LAZ files of any number of points, written in parts: what time and memory are measured with."""

from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np

from gmmjax.geometry import transformed
from gmmjax.pair import Pair
from tests.benchmarks.surveyor.kinds import GRID, GRID_CODE, drawn_from, kind_of
from tests.benchmarks.surveyor.scanning import scanned_parts
from tests.benchmarks.surveyor.surveys import Site, full_columns, motion_about

# Steps of the coordinates in the files, metres.
STEP = 1e-4
WKT = (
    'PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European_Terrestrial_Reference_System_1989",'
    'SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],'
    'PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],'
    'PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],'
    f'UNIT["metre",1],AXIS["Easting",EAST],AXIS["Northing",NORTH],AUTHORITY["EPSG","{GRID_CODE}"]]'
)


def write_large(paths: Pair[Path], points: int, kind: str = "hall", seed: int = 0, copies: int = 1) -> Pair[int]:
    """Writes the scans of a scene that changed, with survey coordinates.

    Args:
        paths: of the files, .las or .laz.
        points: about so many a side.
        kind: of the scene.
        seed: of the scene.
        copies: of it that stand side by side, farther apart than the scanner reaches, with their share of the points.

    Returns:
        The number of points of each.
    """
    made = kind_of(kind)
    site = made.site(drawn_from(kind, seed), True)
    return Pair(*(_write(path, _parts(site, side, points, kind, seed, copies)) for side, path in enumerate(paths)))


def copies_of(site: Site, copies: int) -> np.ndarray:
    """From the scene to each of its copies [copies, 3], metres: they are farther apart than the scanner reaches."""
    return 1.5 * site.beam.max_range * np.arange(copies)[:, None] * np.array([0.0, 1.0, 0.0])


def _parts(site: Site, side: int, points: int, kind: str, seed: int, copies: int) -> Iterator[tuple[np.ndarray, int]]:
    """Points with the number of their station, in all places where the scene stands."""
    errors = kind_of(kind).errors
    world, stations = [*site.worlds][side], [*site.stations][side]
    random = np.random.default_rng([seed, side, points // copies])
    survey = motion_about(side * errors.survey, side * errors.survey_degrees, stations[0].position, random)
    steps = copies_of(site, copies)
    for number, station in enumerate(stations):
        own = motion_about(errors.station, errors.station_degrees, station.position, random)
        columns = full_columns(world, station, site.beam, points / copies / len(stations), random)
        for scan in scanned_parts(world, columns, site.beam, random):
            for step in steps:
                yield transformed(transformed(scan.points, own) + step, survey) + GRID, number


def _write(path: Path, parts: Iterator[tuple[np.ndarray, int]]) -> int:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, STEP), np.array(GRID)
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(WKT))
    header.global_encoding.wkt = True
    count = 0
    with laspy.open(path, mode="w", header=header) as file:
        for points, station in parts:
            record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
            record.x, record.y, record.z = points.T
            record["point_source_id"] = np.full(len(points), station + 1)
            record["return_number"] = record["number_of_returns"] = np.ones(len(points), np.uint8)
            file.write_points(record)
            count += len(points)
    return count
