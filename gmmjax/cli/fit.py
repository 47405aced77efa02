"""`gmmjax fit CLOUD --out DIR`."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.errors import InputError, check_seed

if TYPE_CHECKING:
    from gmmjax.mixtures import Fit, WeightedPoints

MIXTURE_FILES = {"mixture.json": "weights, means, covariances and how they were found", "mixture.npz": "the arrays"}

Method = Literal["annihilation", "grid"]


def fit(
    cloud: Annotated[Path, "CLOUD"],
    *,
    out: Annotated[Path, "DIR"],
    method: Method = "annihilation",
    max_components: int | None = None,
    restarts: int = 8,
    seed: int = 0,
    voxel_size: Annotated[float | None, "LENGTH"] = None,
    max_points: int = 16384,
    plot: Annotated[Path | None, "FILE.png"] = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Fit a Gaussian mixture to a scan; the number of Gaussians comes from the data.

    Args:
        cloud: the scan.
        out: folder for mixture.json and mixture.npz; created if missing.
        method: "annihilation" starts with many Gaussians and removes the weak; "grid" tries every number and covariance
            type (slow).
        max_components: maximum number of Gaussians. None: 25, or a tenth of the points where that is less.
        restarts: random restarts; the fit with the shortest message length is kept.
        seed: seed of the random starts.
        voxel_size: edge of the voxels that the scan is reduced to. None: the smallest that leaves `max_points`.
        max_points: a scan with more points is reduced to voxels, at most this number.
        plot: also draw the scan with its Gaussians: .png, .svg or .pdf.
        overwrite: replace a previous mixture in that folder.
        quiet: print nothing but errors.
    """
    from gmmjax.changes import check_lengths, default_components, reduced, warn_of_stray_points
    from gmmjax.clouds import read_cloud, scan_bounds, voxel_size_for, within
    from gmmjax.reporting import console
    from gmmjax.reporting.mixture_files import check_mixture_folder, write_mixture

    check_seed("--seed", seed)
    check_mixture_folder(out, overwrite=overwrite)
    if plot is not None:
        from gmmjax.plotting import check_figure_file

        check_figure_file(plot, created=out)
    use_compilation_cache()
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        progress("Reading the cloud", 0.0)
        whole = read_cloud(cloud)
        check_lengths("cloud", whole)
        bounds = scan_bounds(whole.points)
        read = whole.part(within(whole.points, bounds))
        stray = len(whole) - len(read)
        warn_of_stray_points(str(cloud), stray, bounds)
        try:
            if voxel_size is None and len(read) > max_points:
                voxel_size = voxel_size_for(read.points, max_points)
            weighted = reduced(read.points, voxel_size)
            if max_components is None:
                max_components = default_components(len(weighted.mass))
            found = _best_fit(weighted, method, max_components, restarts, seed, progress)
        except InputError as error:
            raise InputError(f"{cloud}: {error}") from error
        given = {"method": method, "max_components": max_components, "restarts": restarts, "seed": seed}
        counts = {"points": len(read), "rows_dropped": read.rows_dropped, "stray": stray}
        settings = {**given, **counts, "points_fitted": len(weighted.mass), "voxel_size": voxel_size}
        write_mixture(out, found, source=str(cloud), settings=settings, overwrite=overwrite)
        if plot is not None:
            from gmmjax.plotting import fit_figure, write_figure

            write_figure(plot, fit_figure(found, read))
    if not quiet:
        console.print_fit(found, read)
        console.print_files(out, MIXTURE_FILES)
        console.print_plot(plot)
    return 0


def _best_fit(
    weighted: "WeightedPoints",
    method: Method,
    max_components: int,
    restarts: int,
    seed: int,
    progress: Callable[[str, float], None],
) -> "Fit":
    import jax

    from gmmjax.mixtures import best_fit, fit_mixture, fit_restarts

    settings = {"key": jax.random.key(seed), "mass": weighted.mass, "max_components": max_components}
    if method == "grid":
        progress("Trying every number of Gaussians", 0.0)
        return fit_mixture(weighted.points, restarts=restarts, method="grid", **settings)
    progress("Fitting", 0.0)
    done = itertools.count(1)
    fits = fit_restarts(
        weighted.points,
        scatter=weighted.scatter,
        restarts=restarts,
        progress=lambda: progress("Fitting", next(done) / restarts),
        **settings,
    )
    return best_fit(fits)
