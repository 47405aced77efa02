"""Changes by one mixture for both clouds: registration, fit, segments with evidence, moved objects."""

import dataclasses
import warnings
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import ArrayLike, Bool, Int

from gmmjax.changes.change import Change, Changes, Kind
from gmmjax.changes.checking import CheckedCloud, check_pair
from gmmjax.changes.clock import Clock, Progress
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.consensus import CloudConsensus, merged
from gmmjax.changes.free_space import Survey
from gmmjax.changes.joint_fit import JointFits, fit_joint_restarts, mixtures_distance, point_excess
from gmmjax.changes.joint_problem import SETTINGS, JointProblem, joint_problem
from gmmjax.changes.local_difference import difference_scale, local_difference
from gmmjax.changes.moved import with_moved
from gmmjax.changes.registration import LEAST_OVERLAP, Registration, register
from gmmjax.changes.scales import WorkingCloud, WorkingPair, working_pair
from gmmjax.changes.surface import SurfaceCloud, SurfaceScales, surface_changes
from gmmjax.changes.surface_consensus import surface_consensus
from gmmjax.changes.view_checks import check_views
from gmmjax.changes.volumetric import restart_weights, volumetric_changes
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.clouds.local_surface import moved_points
from gmmjax.errors import InputWarning
from gmmjax.mixtures import FitStatus

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
        pair = pair.with_after(surveys[1].points)
    clock.lap("registration")
    report("Fitting the mixtures", 0.25)
    problem = joint_problem(pair, registration, config)
    fits = _fit(problem, config, report)
    clock.lap("fits")
    report("Looking for changes", 0.75)
    if pair.volumetric:
        detected = _volumetric(checked, problem, fits, registration, config)
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
        diagnostics=_diagnostics((before, after), checked, pair, fits, registration, problem, surveys, clock),
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


def _fit(problem: JointProblem, config: DetectionConfig, report: Progress) -> JointFits:
    restarts = config.number_of_restarts(on_surfaces=not problem.volumetric)
    done = iter(range(1, restarts + 1))
    return fit_joint_restarts(
        problem.points,
        key=jax.random.key(config.seed),
        max_components=problem.max_components,
        slots=problem.slots,
        prior=problem.prior,
        restarts=restarts,
        max_points=problem.max_points,
        settings=SETTINGS,
        progress=lambda: report("Fitting the mixtures", 0.25 + 0.5 * next(done) / restarts),
    )


def _volumetric(
    checked: tuple[CheckedCloud, CheckedCloud],
    problem: JointProblem,
    fits: JointFits,
    registration: Registration,
    config: DetectionConfig,
) -> _Detected:
    weights = restart_weights(fits, comparable=len(problem.points.after) <= problem.max_points)
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
    problem: JointProblem,
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
        "tolerance": float(problem.prior.tolerance),
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
