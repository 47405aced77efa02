"""Maps written to files: what the command line's `--map-2d` makes."""

import os
from pathlib import Path

from gmmjax.changes import Changes
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.plotting.change_map import map_figure
from gmmjax.plotting.figure_files import check_figure_file, check_folder_of, write_figure
from gmmjax.reporting.geotiff import check_rasterio, write_geotiff
from gmmjax.reporting.map_cells import ChangeMapSettings, change_map

GEOTIFF = (".tif", ".tiff")


def check_map_file(path: str | os.PathLike[str], created: Path | None = None) -> None:
    """Whether a map can be written to this file; called before a long computation.

    Args:
        path: .tif or .tiff for GeoTIFF, else as of `check_figure_file`.
        created: as of `check_figure_file`.

    Raises:
        InputError: what it needs is not installed; an ending that is not known; a folder that is missing or cannot be
            written; a path that is a folder.
    """
    file = Path(path)
    if file.suffix.lower() not in GEOTIFF:
        check_figure_file(file, created)
        return
    check_rasterio()
    if file.is_dir():
        raise InputError(f"{file}: is a folder; give the name of a file, such as {file / 'map.tif'}")
    check_folder_of(file, created)


def write_map(
    path: str | os.PathLike[str],
    changes: Changes,
    clouds: Pair[PointCloud],
    settings: ChangeMapSettings = ChangeMapSettings(),
) -> None:
    """Writes a map from above: a GeoTIFF for .tif and .tiff, else a picture; whole or not at all.

    Args:
        path: of the file; one that is there is replaced.
        changes: what was found.
        clouds: as they were given to the detection.
        settings: the grid of the GeoTIFF.

    Raises:
        InputError: as of `check_map_file`; scans that have no upward direction along z, or fill volumes.
    """
    check_map_file(path)
    if Path(path).suffix.lower() in GEOTIFF:
        write_geotiff(path, change_map(changes, clouds, settings))
    else:
        write_figure(path, map_figure(changes, clouds))
