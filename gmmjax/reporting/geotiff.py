"""Maps as GeoTIFF, which QGIS, ArcGIS and GDAL read, written by rasterio (the extra `map`)."""

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gmmjax.clouds import atomic_write, epsg_code, is_wkt, system_name
from gmmjax.errors import InputError, warn
from gmmjax.reporting.map_cells import ChangeMap

BANDS = {
    "distance": "signed distance of the after surface from the before surface",
    "probability": "probability that something changed",
    "label": "change, as in changes.csv; -1: none",
    "level_of_detection": "distance of a point that is significant at 95 %",
}


def check_rasterio() -> None:
    """Raise an InputError with the remedy unless rasterio is there."""
    try:
        import rasterio  # noqa: F401
    except ImportError as error:
        raise InputError("GeoTIFF needs rasterio, which is not installed: pip install 'gmmjax[map]'") from error


def write_geotiff(path: str | os.PathLike[str], found: ChangeMap) -> None:
    """Write a map as GeoTIFF, whole or not at all: a band of float32 for each of `BANDS`, NaN where nothing is known.

    Origin and cell are in float64, so that coordinates of a survey lose nothing.

    Args:
        path: of the file; one that is there is replaced.
        found: the map.

    Raises:
        InputError: rasterio is not installed; the file cannot be written.

    Warns:
        InputWarning: a reference system that GDAL does not know; the file is without one.
    """
    check_rasterio()
    import rasterio
    from rasterio.io import MemoryFile
    from rasterio.transform import Affine

    rows, columns = found.distance.shape
    profile = {
        "driver": "GTiff",
        "width": columns,
        "height": rows,
        "count": len(BANDS),
        "dtype": "float32",
        "nodata": np.nan,
        "compress": "deflate",
        "predictor": 3,
        "tiled": True,
        "transform": Affine(found.cell, 0.0, found.left, 0.0, -found.cell, found.top),
        "crs": _reference_system(path, found.crs),
    }
    with warnings.catch_warnings():
        # A scan at the origin with cells of 1 is the identity, which GDAL takes for no place at all.
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with MemoryFile() as memory:
            with memory.open(**profile) as raster:
                for number, (name, text) in enumerate(BANDS.items(), start=1):
                    raster.write(getattr(found, name).astype(np.float32), number)
                    raster.set_band_description(number, f"{name}: {text}")
                raster.update_tags(unit=found.unit or "", software="gmmjax")
            content = bytes(memory.getbuffer())
    try:
        with atomic_write(path) as file:
            file.write(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def longitude_latitude(places: Float[np.ndarray, "n 2"], crs: str) -> Float[np.ndarray, "n 2"] | None:
    """Convert x and y of a system to longitude and latitude, degrees of WGS 84, by PROJ.

    None where rasterio is not installed, or the system is no map projection that GDAL knows and that holds there.
    """
    try:
        from rasterio.crs import CRS
        from rasterio.warp import transform
    except ImportError:
        return None
    system = _gdal_system(crs)
    if system is None or not system.is_projected:
        return None
    try:
        degrees = np.stack(transform(system, CRS.from_epsg(4326), *places.T), axis=1)
    # GDAL's errors have no public class.
    except Exception:
        return None
    return degrees if np.isfinite(degrees).all() else None


def _gdal_system(crs: str) -> Any | None:
    """Return a system as rasterio has it; None where GDAL does not know it."""
    import rasterio
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    # GDAL would look for other names among all that it knows, and take the next best.
    if epsg_code(crs) is None and not is_wkt(crs):
        return None
    try:
        # Without an environment GDAL prints what it does not know.
        with rasterio.Env():
            return CRS.from_user_input(crs)
    except CRSError:
        return None


def _reference_system(path: str | os.PathLike[str], crs: str | None) -> Any | None:
    """Return a system as rasterio has it; None, with a warning, where GDAL does not know it."""
    if crs is None:
        return None
    system = _gdal_system(crs)
    if system is None:
        warn(
            f"{Path(path).name}: {system_name(crs)} is not known to GDAL; the map is written without a reference system"
        )
    return system
