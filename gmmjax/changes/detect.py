"""Change detection end to end: two clouds in, `Changes` out."""

import dataclasses
from typing import Any

from jaxtyping import ArrayLike

from gmmjax._host import is_traced
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.consensus import Consensus
from gmmjax.changes.detectors import DETECTORS, AbstractRestartDetector, Scan
from gmmjax.changes.fit.restart_fits import RestartFits
from gmmjax.changes.prepare.units import common_unit, stated_system
from gmmjax.changes.progress import Progress, silent
from gmmjax.changes.record import Changes
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.comparison import Method
from gmmjax.errors import InputError, recorded_warnings, shown
from gmmjax.pair import Pair


def detect_changes(
    before: ArrayLike | PointCloud,
    after: ArrayLike | PointCloud,
    *,
    method: Method | None = None,
    restarts: int | None = None,
    seed: int | None = None,
    config: DetectionConfig | None = None,
    views_before: SensorViews | None = None,
    views_after: SensorViews | None = None,
    progress: Progress | None = None,
) -> Changes:
    """Detect what changed between two point clouds, with a probability of each change.

    Args:
        before: coordinates [n0, 3], or a `PointCloud`, in any unit. Rows that are not finite, and stray
            points (`gmmjax.clouds.scan_bounds`), are never changed.
        after: the cloud at the later time [n1, 3], in the same unit and about the same frame.
        method: "joint" (one mixture for both clouds), "greedy" (the thesis's Algorithm 1) or "transport" (partial
            transport); None: the config's, "joint".
        restarts: random starts of the fits; None: the config's.
        seed: of the random starts; None: the config's.
        config: all settings; default `DetectionConfig()`.
        views_before: where the sensor stood in the survey of the before cloud, in its frame. None: the cloud's own
            `PointCloud.views`, if it has any. With views a change must lie where the other survey saw that there was
            nothing; without them surfaces that go on where one survey did not look are told by their shape.
        views_after: the same for the after cloud.
        progress: called with the name of the stage and the share of the work that is done, from any thread.

    Returns:
        The changes, with a label and a probability for every row of both clouds.

    Raises:
        InputError: clouds, views or settings that cannot be used; files that state two units or reference systems, or
            angles; extents that do not overlap, where no registration is made or it is in doubt; or that are far apart
            in the one reference system that both files state; two flat clouds in one plane, by the method "joint".
        ComputationError: no restart gave a mixture, or no pair of separate mixtures could be compared.

    Warns:
        InputWarning: rows of an array that are not finite; stray points; extents that differ as if in another unit; a
            registration in doubt; views that contradict their cloud, which are not used.
    """
    config = _overridden(config or DetectionConfig(), method=method, restarts=restarts, seed=seed)
    scans = _scans(before, after, views_before, views_after)
    with recorded_warnings() as warnings:
        unit = common_unit(Pair(before, after), config)
        changes = DETECTORS[config.method](config).changes(scans, progress or silent)
    clouds = scans.map(lambda scan: scan.cloud)
    crs = stated_system(before)
    return dataclasses.replace(changes, warnings=tuple(warnings), unit=unit, crs=crs, clouds=clouds)


def detect_consensus(
    before: ArrayLike | PointCloud,
    after: ArrayLike | PointCloud,
    *,
    config: DetectionConfig | None = None,
    views_before: SensorViews | None = None,
    views_after: SensorViews | None = None,
    earlier: RestartFits | None = None,
    until_stable: float | None = None,
    progress: Progress | None = None,
) -> Consensus:
    """`detect_changes` with the fits of its restarts, which more can be added to, and how sure the average is.

    64 restarts after 16 compute 48, and give what 64 at once do, in every bit.

    Args:
        before: as of `detect_changes`.
        after: as of `detect_changes`.
        config: all settings; `restarts` is how many there are in all, or the most of them with `until_stable`.
        views_before: as of `detect_changes`.
        views_after: as of `detect_changes`.
        earlier: fits of an earlier consensus of the same clouds and settings but `restarts`, which are not computed
            again; that they are of the same is for the caller to know.
        until_stable: ends after 2, 4, 8, ... restarts when the last doubling has changed the mean probability of no
            change by this much; the record is that of a detection with as many restarts. None: all are computed.
        progress: as of `detect_changes`.

    Returns:
        The changes, all fits, and the standard errors of the changes' probabilities.

    Raises:
        InputError: clouds, views or settings that cannot be used; fits of another method, or of mixtures of another
            size; a method without restarts.
        ComputationError: as of `detect_changes`.

    Warns:
        InputWarning: as of `detect_changes`.
    """
    config = config or DetectionConfig()
    _check_tolerance(until_stable)
    detector = DETECTORS[config.method](config)
    if not isinstance(detector, AbstractRestartDetector):
        raise InputError(f"method={config.method} has no restarts to average over; choose another, or detect_changes")
    scans = _scans(before, after, views_before, views_after)
    with recorded_warnings() as warnings:
        unit = common_unit(Pair(before, after), config)
        consensus = detector.consensus(scans, earlier=earlier, until_stable=until_stable, report=progress or silent)
    crs = stated_system(before)
    changes = dataclasses.replace(consensus.changes, warnings=tuple(warnings), unit=unit, crs=crs)
    return dataclasses.replace(consensus, changes=changes)


def _check_tolerance(until_stable: float | None) -> None:
    number = isinstance(until_stable, int | float) and not isinstance(until_stable, bool)
    if until_stable is not None and not (number and 0 < until_stable <= 1):
        raise InputError(f"until_stable={shown(until_stable)} must be a probability above 0, such as 0.02")


def _scans(
    before: ArrayLike | PointCloud,
    after: ArrayLike | PointCloud,
    views_before: SensorViews | None,
    views_after: SensorViews | None,
) -> Pair[Scan]:
    if is_traced(before, after):
        raise InputError(
            "detect_changes is a host function: call it outside of jit, vmap and grad, in which fit_mixture and "
            "earth_movers_distance can be used"
        )
    for name, views in (("views_before", views_before), ("views_after", views_after)):
        if not isinstance(views, SensorViews | None):
            raise InputError(f"{name} must be SensorViews, not a {type(views).__name__}; read a file by read_views")
    return Pair(Scan(before, _views(before, views_before)), Scan(after, _views(after, views_after)))


def _overridden(config: DetectionConfig, **settings: Any) -> DetectionConfig:
    return dataclasses.replace(config, **{name: value for name, value in settings.items() if value is not None})


def _views(cloud: ArrayLike | PointCloud, given: SensorViews | None) -> SensorViews | None:
    return cloud.views if given is None and isinstance(cloud, PointCloud) else given
