"""Changes by one mixture for both clouds: registration, fit, segments with evidence, moved objects."""

import dataclasses
import warnings
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import ArrayLike, Bool, Float, Int

from gmmjax.changes.change import Change, Changes, Kind
from gmmjax.changes.checking import CheckedCloud, check_pair
from gmmjax.changes.clock import Clock, Progress
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.consensus import CloudConsensus, merged
from gmmjax.changes.free_space import Survey
from gmmjax.changes.joint_fit import JointFits, fit_joint_restarts, mixtures_distance, point_excess
from gmmjax.changes.joint_mixture import SourcedPoints, joint_prior
from gmmjax.changes.local_difference import difference_scale, local_difference
from gmmjax.changes.local_surface import moved_points
from gmmjax.changes.moved import with_moved
from gmmjax.changes.registration import LEAST_OVERLAP, Registration, register
from gmmjax.changes.scales import WorkingCloud, WorkingPair, working_pair
from gmmjax.changes.surface import SurfaceCloud, SurfaceScales, surface_changes
from gmmjax.changes.surface_consensus import surface_consensus
from gmmjax.changes.view_checks import check_views
from gmmjax.changes.volumetric import restart_weights, volumetric_changes
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.errors import InputError, InputWarning
from gmmjax.mixtures import FitSettings, FitStatus, WeightedPoints
from gmmjax.mixtures.map_fits import RELATIVE_NOISE_FLOOR

# Components that annihilation starts from, and points that a restart sees: on surfaces the mixture need not be fine,
# because distances see what is small.
SURFACE_COMPONENTS, VOLUME_COMPONENTS = 40, 25
SURFACE_POINTS = 6_000
POINTS_PER_COMPONENT = 20
SETTINGS = FitSettings(patience=0.02, tolerance=3e-5)
# The registration tolerance of scans, in spacings.
TOLERANCE_SPACINGS = 2.0
# The scatter of voxel means on a surface, in spacings: that of a uniform distribution.
SCATTER = 12**-0.5


# The kind of a change in the before and in the after cloud.
KINDS: tuple[Kind, Kind] = ("disappeared", "appeared")


class _Detected(NamedTuple):
    """What was found in both clouds; `noise` is the usual offset between unchanged surfaces."""

    before: CloudConsensus
    after: CloudConsensus
    unobserved_before: Bool[np.ndarray, " n0"]
    unobserved_after: Bool[np.ndarray, " n1"]
    noise: float


def joint_changes(
    before: ArrayLike | PointCloud,
    after: ArrayLike | PointCloud,
    views_before: SensorViews | None,
    views_after: SensorViews | None,
    config: DetectionConfig,
    report: Progress,
) -> Changes:
    """Changes by the joint mixture. Arguments, errors and warnings as in `detect_changes`."""
    clock = Clock()
    report("Reading the scales of the clouds", 0.0)
    checked = check_pair(before, after, config)
    pair = working_pair(checked[0].points, checked[1].points, config)
    surveys = (
        _with_usable_views("views_before", Survey(pair.before.points, views_before)),
        _with_usable_views("views_after", Survey(pair.after.points, views_after)),
    )
    clock.lap("preparation")
    report("Aligning the clouds", 0.1)
    registration = register(pair, surveys[0].surface, surveys[1].surface, config)
    _warn_about_overlap(registration)
    if registration.applied:
        surveys = surveys[0], surveys[1].moved(registration.transform)
        pair = _aligned(pair, surveys[1].points)
    clock.lap("registration")
    report("Fitting the mixtures", 0.25)
    tolerance = _tolerance(pair, registration, config)
    fits = _fit(pair, config, tolerance, report)
    clock.lap("fits")
    report("Looking for changes", 0.75)
    if pair.volumetric:
        detected = _volumetric(checked, pair, fits, registration, config)
    else:
        detected = _surface(checked, pair, fits, surveys, config)
    detected = _of_kinds(detected, config)
    items, labels_before, labels_after = merged(detected.before, detected.after)
    clock.lap("changes")
    report("Looking for moved objects", 0.9)
    if not pair.volumetric:
        items = _moved(items, (labels_before, labels_after), pair, surveys, registration, detected.noise)
    clock.lap("moved")
    report("Done", 1.0)
    return Changes(
        labels_before=checked[0].to_rows(labels_before, -1),
        labels_after=checked[1].to_rows(labels_after, -1),
        probability_before=checked[0].to_rows(detected.before.probability, 0.0),
        probability_after=checked[1].to_rows(detected.after.probability, 0.0),
        unobserved_before=checked[0].to_rows(detected.unobserved_before, False),
        unobserved_after=checked[1].to_rows(detected.unobserved_after, False),
        items=items,
        emd=mixtures_distance(fits),
        config=config,
        diagnostics=_diagnostics((before, after), checked, pair, fits, registration, tolerance, surveys, clock),
    )


def _with_usable_views(name: str, survey: Survey) -> Survey:
    """The survey, without its views where they contradict the cloud."""
    contradiction = None if survey.views is None else check_views(name, survey)
    if contradiction is None:
        return survey
    warnings.warn(contradiction, InputWarning, stacklevel=4)
    return Survey(survey.points)


def _warn_about_overlap(registration: Registration) -> None:
    if registration.overlap < LEAST_OVERLAP:
        warnings.warn(
            f"only {registration.overlap:.0%} of the points of one cloud have a counterpart in the other, so what is "
            "found means little: are both of the same place, in the same frame and unit? registration='always' tries "
            "harder to align them, crop leaves out what only one cloud has",
            InputWarning,
            stacklevel=4,
        )


def _aligned(pair: WorkingPair, after: Float[np.ndarray, "n1 3"]) -> WorkingPair:
    return dataclasses.replace(pair, after=dataclasses.replace(pair.after, points=after))


def _tolerance(pair: WorkingPair, registration: Registration, config: DetectionConfig) -> float:
    """The tolerance of registration grows with its residual; on surfaces it is never below the points' own scatter."""
    if config.tolerance is not None:
        return config.tolerance
    return registration.residual if pair.volumetric else max(TOLERANCE_SPACINGS * pair.spacing, registration.residual)


def _fit(pair: WorkingPair, config: DetectionConfig, tolerance: float, report: Progress) -> JointFits:
    clouds = (pair.before, pair.after)
    points = np.concatenate([cloud.points for cloud in clouds])
    # The density of a scan is an accident of where the sensor stood: on surfaces every voxel counts the same.
    masses = [cloud.mass if pair.volumetric else np.ones(len(cloud.mass)) for cloud in clouds]
    after = np.repeat([0.0, 1.0], [len(cloud.points) for cloud in clouds])
    restarts = config.number_of_restarts(on_surfaces=not pair.volumetric)
    done = iter(range(1, restarts + 1))
    return fit_joint_restarts(
        SourcedPoints(WeightedPoints(points, np.concatenate(masses)), after),
        key=jax.random.key(config.seed),
        max_components=_components(pair, config),
        prior=joint_prior(_noise_floor(pair, points, config), tolerance),
        restarts=restarts,
        max_points=_points_of_a_fit(pair, config),
        settings=SETTINGS,
        progress=lambda: report("Fitting the mixtures", 0.25 + 0.5 * next(done) / restarts),
    )


def _components(pair: WorkingPair, config: DetectionConfig) -> int:
    points = len(pair.before.points) + len(pair.after.points)
    if config.max_components is not None:
        if config.max_components > points:
            raise InputError(
                f"max_components={config.max_components} is more than the {points} points (or voxels) of both clouds; "
                f"choose at most {max(1, points // POINTS_PER_COMPONENT)}"
            )
        return config.max_components
    default = VOLUME_COMPONENTS if pair.volumetric else SURFACE_COMPONENTS
    return max(1, min(default, points // POINTS_PER_COMPONENT))


def _points_of_a_fit(pair: WorkingPair, config: DetectionConfig) -> int:
    return config.max_points if pair.volumetric else min(config.max_points, SURFACE_POINTS)


def _noise_floor(pair: WorkingPair, points: np.ndarray, config: DetectionConfig) -> float:
    if config.noise_floor is not None:
        return config.noise_floor
    if not pair.volumetric:
        return SCATTER * pair.spacing
    return RELATIVE_NOISE_FLOOR["float64"] * float(np.sqrt(points.var(axis=0).mean()))


def _volumetric(
    checked: tuple[CheckedCloud, CheckedCloud],
    pair: WorkingPair,
    fits: JointFits,
    registration: Registration,
    config: DetectionConfig,
) -> _Detected:
    fitted = len(pair.before.points) + len(pair.after.points)
    weights = restart_weights(fits, comparable=fitted <= _points_of_a_fit(pair, config))
    aligned = checked[0].points, moved_points(checked[1].points, registration.transform)
    found = [
        volumetric_changes(cloud.points, points, fits, weights, kind, config.threshold)
        for cloud, points, kind in zip(checked, aligned, KINDS, strict=True)
    ]
    nothing = [np.zeros(len(points), bool) for points in aligned]
    return _Detected(found[0], found[1], nothing[0], nothing[1], noise=0.0)


def _surface(
    checked: tuple[CheckedCloud, CheckedCloud],
    pair: WorkingPair,
    fits: JointFits,
    surveys: tuple[Survey, Survey],
    config: DetectionConfig,
) -> _Detected:
    clouds = (pair.before, pair.after)
    differences = [local_difference(surveys[i].surface, surveys[1 - i].surface) for i in (0, 1)]
    usual = difference_scale(*differences)
    scales = SurfaceScales.of(pair.spacing, usual)
    known = [
        SurfaceCloud(cloud.points, difference, point_excess(fits, cloud.points, kind == "appeared"))
        for cloud, difference, kind in zip(clouds, differences, KINDS, strict=True)
    ]
    segments = surface_changes((known[0], known[1]), surveys, scales, config)
    found = [
        surface_consensus(checked[i].points, clouds[i].member, known[i], segments[i], usual, KINDS[i]) for i in (0, 1)
    ]
    unobserved = [segments[i].unobserved[clouds[i].member] for i in (0, 1)]
    return _Detected(found[0], found[1], unobserved[0], unobserved[1], noise=usual.offset)


def _moved(
    items: tuple[Change, ...],
    labels: tuple[Int[np.ndarray, " n0"], Int[np.ndarray, " n1"]],
    pair: WorkingPair,
    surveys: tuple[Survey, Survey],
    registration: Registration,
    noise: float,
) -> tuple[Change, ...]:
    """With the moved objects; their motions are those of the clouds as they were given."""
    of_working = _of_working_points(pair.before, labels[0]), _of_working_points(pair.after, labels[1])
    to_given = np.linalg.inv(registration.transform)
    return tuple(
        change if change.transform is None else dataclasses.replace(change, transform=to_given @ change.transform)
        for change in with_moved(items, surveys[0].surface, surveys[1].surface, *of_working, noise)
    )


def _of_working_points(cloud: WorkingCloud, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    working = np.empty(len(cloud.points), int)
    working[cloud.member] = labels
    return working


def _of_kinds(detected: _Detected, config: DetectionConfig) -> _Detected:
    """Without the changes of the kind that is not looked for."""
    before = _none(detected.before) if config.kinds == "appeared" else detected.before
    after = _none(detected.after) if config.kinds == "disappeared" else detected.after
    return detected._replace(before=before, after=after)


def _none(found: CloudConsensus) -> CloudConsensus:
    return CloudConsensus(np.zeros_like(found.probability), np.full_like(found.labels, -1), [])


def _diagnostics(
    given: tuple[ArrayLike | PointCloud, ArrayLike | PointCloud],
    checked: tuple[CheckedCloud, CheckedCloud],
    pair: WorkingPair,
    fits: JointFits,
    registration: Registration,
    tolerance: float,
    surveys: tuple[Survey, Survey],
    clock: Clock,
) -> dict[str, Any]:
    """Plain values for the record and the report."""
    return {
        "before": _cloud_diagnostics(given[0], checked[0], pair.before, surveys[0].views),
        "after": _cloud_diagnostics(given[1], checked[1], pair.after, surveys[1].views),
        "voxel_size": pair.voxel_size,
        "spacing": pair.spacing,
        "volumetric": pair.volumetric,
        "tolerance": tolerance,
        "registration": registration.to_dict(),
        "components": fits.joint.mixture.live.sum(axis=1).tolist(),
        "message_length": np.round(fits.message_length, 3).tolist(),
        "density_ratio": np.round(fits.density_ratio, 4).tolist(),
        "steps": fits.steps.tolist(),
        "converged": np.asarray(fits.result == FitStatus.converged).tolist(),
        "seconds": clock.seconds,
        "device": jax.devices()[0].device_kind,
        "precision": "float64",
    }


def _cloud_diagnostics(
    given: ArrayLike | PointCloud, cloud: CheckedCloud, working: WorkingCloud, views: SensorViews | None
) -> dict[str, Any]:
    return {
        **cloud.diagnostics(given),
        "points_compared": len(working.points),
        "views": 0 if views is None else len(views),
    }
