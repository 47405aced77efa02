"""Figures and maps written to files, without pyplot: what the command line's `--plot` and `--map-2d` make."""

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from gmmjax.changes import Changes
from gmmjax.clouds import PointCloud, atomic_write
from gmmjax.errors import InputError
from gmmjax.mixtures import Fit
from gmmjax.pair import Pair
from gmmjax.plotting.axes import elided, verbatim
from gmmjax.plotting.change_map import map_figure
from gmmjax.plotting.changes import draw_overview, fit_height
from gmmjax.plotting.cloud_image import PIXELS
from gmmjax.plotting.mixtures import plot_mixture
from gmmjax.plotting.projection import Direction
from gmmjax.reporting.geotiff import check_rasterio, write_geotiff
from gmmjax.reporting.map_cells import change_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GEOTIFF = (".tif", ".tiff")


def check_figure_file(path: str | os.PathLike[str], created: Path | None = None) -> None:
    """Check that a figure can be written to this file, before a long computation.

    Args:
        path: its ending tells the format: .png, .svg, .pdf or another one that matplotlib knows.
        created: a folder that will be there when the figure is written; None: no other one than now.

    Raises:
        InputError: an ending that is not known; a folder that is missing or cannot be written; a path that is a folder.
    """
    from matplotlib.figure import Figure

    file = Path(path)
    known = Figure().canvas.get_supported_filetypes()
    if file.suffix.lower().removeprefix(".") not in known:
        raise InputError(
            f"{file}: matplotlib writes no figures with the ending {file.suffix!r}; choose one of "
            f"{' '.join(f'.{name}' for name in sorted(known))}"
        )
    _check_place(file, created)


def check_map_file(path: str | os.PathLike[str], created: Path | None = None) -> None:
    """Check that a map can be written to this file: a figure, or .tif and .tiff for GeoTIFF.

    Raises:
        InputError: as `check_figure_file`; GeoTIFF without rasterio.
    """
    if Path(path).suffix.lower() not in GEOTIFF:
        check_figure_file(path, created)
        return
    check_rasterio()
    _check_place(Path(path), created)


def write_figure(path: str | os.PathLike[str], figure: "Figure") -> None:
    """Write a figure, whole or not at all; one that is there is replaced.

    Args:
        path: as of `check_figure_file`.
        figure: of matplotlib.

    Raises:
        InputError: as of `check_figure_file`; the file cannot be written.
    """
    check_figure_file(path)
    from matplotlib import rc_context

    form = Path(path).suffix.lower().removeprefix(".")
    # The same input gives the same bytes.
    metadata = {"Date": None} if form in ("svg", "svgz") else {"CreationDate": None} if form == "pdf" else {}
    try:
        with atomic_write(path) as file, rc_context({"svg.hashsalt": "gmmjax"}), warnings.catch_warnings():
            # The names of files may be in any script, also in one that no font here has: those are drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
            # No metadata at all where there is none: JPEG takes none, not even an empty one.
            figure.savefig(file, format=form, dpi=150, metadata=metadata or None)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_map(
    path: str | os.PathLike[str], changes: Changes, clouds: Pair[PointCloud], cell: float | None = None
) -> None:
    """Write a map from above: a GeoTIFF for .tif and .tiff, else a picture; whole or not at all.

    Args:
        path: of the file; one that is there is replaced.
        changes: what was found.
        clouds: as they were given to the detection.
        cell: as of `change_map`.

    Raises:
        InputError: as of `check_map_file`; scans that have no upward direction along z, or fill volumes.
    """
    check_map_file(path)
    if Path(path).suffix.lower() in GEOTIFF:
        write_geotiff(path, change_map(changes, clouds, cell))
    else:
        write_figure(path, map_figure(changes, clouds, cell))


def overview_figure(changes: Changes, clouds: Pair[PointCloud], pixels: int = PIXELS) -> "Figure":
    """Draw both scans, and the changes from above and from the side; what `Changes.plot` draws."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 9), layout="compressed")
    draw_overview(figure, changes, *clouds, pixels=pixels)
    return figure


def fit_figure(fit: Fit, cloud: PointCloud, pixels: int = PIXELS) -> "Figure":
    """Draw a scan with the Gaussians of its mixture, as the report looks at first and from above."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6), layout="compressed")
    axes = figure.subplots(1, 2, squeeze=False)
    views: tuple[tuple[Direction, str], ...] = (("oblique", "Oblique"), ("above", "From above"))
    for ax, (direction, title) in zip(axes.flat, views, strict=True):
        plot_mixture(fit.mixture, cloud, direction=direction, ax=ax, pixels=pixels)
        ax.set_title(title, fontsize="medium")
    count = int(fit.mixture.count)
    name = Path(cloud.source).name if cloud.source else f"{len(cloud):,} points"
    found = f"{count:,} Gaussian{'s' * (count != 1)}, message length {float(fit.message_length):,.1f} nats"
    verbatim(figure.suptitle(f"{found}\n{elided(name)}", fontsize="large"))
    fit_height(figure, axes)
    return figure


def _check_place(file: Path, created: Path | None) -> None:
    if file.is_dir():
        raise InputError(f"{file}: is a folder; give the name of a file, such as {file / f'changes{file.suffix}'}")
    if created is not None and file.parent.absolute() == created.absolute():
        return
    if not file.parent.is_dir() or not os.access(file.parent, os.W_OK):
        raise InputError(f"{file}: its folder is missing or cannot be written; create it, or choose another one")
