"""Figures written to files, without pyplot: what the command line's `--plot` makes."""

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from gmmjax.changes import Changes, presented
from gmmjax.clouds import PointCloud, atomic_write
from gmmjax.errors import InputError
from gmmjax.mixtures import Fit
from gmmjax.pair import Pair
from gmmjax.plotting.changes import draw_overview, fit_height, title_overview
from gmmjax.plotting.cloud_image import CloudImageSettings
from gmmjax.plotting.figures import check_matplotlib, elided, verbatim
from gmmjax.plotting.mixtures import plot_mixture
from gmmjax.plotting.projection import Direction

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_figure_file(path: str | os.PathLike[str], created: Path | None = None) -> None:
    """Whether a figure can be written to this file; called before a long computation.

    Args:
        path: its ending tells the format: .png, .svg, .pdf or another one that matplotlib knows.
        created: a folder that will be there when the figure is written; None: no other one than now.

    Raises:
        InputError: matplotlib is not installed; an ending that it does not know; a folder that is missing or cannot be
            written; a path that is a folder.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    file = Path(path)
    known = Figure().canvas.get_supported_filetypes()
    if file.suffix.lower().removeprefix(".") not in known:
        raise InputError(
            f"{file}: matplotlib writes no figures with the ending {file.suffix!r}; choose one of "
            f"{' '.join(f'.{name}' for name in sorted(known))}"
        )
    if file.is_dir():
        raise InputError(f"{file}: is a folder; give the name of a file, such as {file / 'changes.png'}")
    check_folder_of(file, created)


def check_folder_of(file: Path, created: Path | None = None) -> None:
    """Whether a file can be written to its folder.

    Args:
        file: that will be written.
        created: a folder that will be there by then; None: no other one than now.

    Raises:
        InputError: the folder is missing or cannot be written.
    """
    if created is not None and file.parent.absolute() == created.absolute():
        return
    if not file.parent.is_dir() or not os.access(file.parent, os.W_OK):
        raise InputError(f"{file}: its folder is missing or cannot be written; create it, or choose another one")


def write_figure(path: str | os.PathLike[str], figure: "Figure") -> None:
    """Writes a figure, whole or not at all; one that is there is replaced.

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


def overview_figure(
    changes: Changes, clouds: Pair[PointCloud], settings: CloudImageSettings = CloudImageSettings()
) -> "Figure":
    """Both scans, and the changes from above and from the side; what `Changes.plot` draws.

    Args:
        changes: what was found.
        clouds: as they were given to the detection.
        settings: how they are drawn.

    Raises:
        InputError: matplotlib is not installed; clouds that are not those of the changes.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    shown = presented(changes, *clouds)
    figure = Figure(figsize=(11, 9), layout="compressed")
    axes = figure.subplots(2, 2)
    draw_overview(shown.changes, shown.clouds, axes.ravel(), settings)
    title_overview(figure, shown.changes, shown.clouds)
    fit_height(figure, axes)
    return figure


def fit_figure(fit: Fit, cloud: PointCloud, settings: CloudImageSettings = CloudImageSettings()) -> "Figure":
    """A scan with the Gaussians of its mixture, as the report looks at first and from above.

    Args:
        fit: of one mixture.
        cloud: that it was fitted to.
        settings: how the cloud is drawn.

    Raises:
        InputError: matplotlib is not installed.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6), layout="compressed")
    axes = figure.subplots(1, 2, squeeze=False)
    views: tuple[tuple[Direction, str], ...] = (("oblique", "Oblique"), ("above", "From above"))
    for ax, (direction, title) in zip(axes.flat, views, strict=True):
        plot_mixture(fit.mixture, cloud, direction=direction, ax=ax, settings=settings)
        ax.set_title(title, fontsize="medium")
    count = int(fit.mixture.count)
    name = Path(cloud.source).name if cloud.source else f"{len(cloud):,} points"
    found = f"{count:,} Gaussian{'s' * (count != 1)}, message length {float(fit.message_length):,.1f} nats"
    verbatim(figure.suptitle(f"{found}\n{elided(name)}", fontsize="large"))
    fit_height(figure, axes)
    return figure
