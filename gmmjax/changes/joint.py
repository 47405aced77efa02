"""Changes by one mixture for both clouds: registration, fit, segments with evidence, moved objects."""

import dataclasses
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import ArrayLike, Bool, Float, Int

from gmmjax.changes.change import Changes, Kind
from gmmjax.changes.checking import CheckedCloud, check_overlap, check_pair
from gmmjax.changes.clock import Clock, Progress
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.consensus import CloudConsensus, merged
from gmmjax.changes.free_space import Survey
from gmmjax.changes.joint_fit import JointFits, fit_joint_restarts, mixtures_distance, point_excess
from gmmjax.changes.joint_problem import SETTINGS, JointProblem, joint_problem
from gmmjax.changes.local_difference import difference_scale, local_difference
from gmmjax.changes.moved import with_moved
from gmmjax.changes.registration import registered_pair
from gmmjax.changes.registration_record import Registration
from gmmjax.changes.scales import WorkingCloud, WorkingPair
from gmmjax.changes.surface import SurfaceCloud, SurfaceScales, surface_changes
from gmmjax.changes.surface_consensus import surface_consensus
from gmmjax.changes.view_checks import check_views
from gmmjax.changes.volumetric import restart_weights, volumetric_changes
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.errors import warn
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

    def believed(self, confidence: float) -> "_Detected":
        """With all probabilities multiplied by the confidence in the registration."""
        if confidence == 1:
            return self
        return self._replace(
            before=_with_confidence(self.before, confidence), after=_with_confidence(self.after, confidence)
        )


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
    clock.lap("preparation")
    report("Registering the clouds", 0.1)
    pair, *surfaces, registration = registered_pair(checked[0].points, checked[1].points, config)
    check_overlap(checked[0].points, checked[1].points, registration)
    _warn_about_registration(registration)
    registered = checked[0].points, registration.apply(checked[1].points)
    if views_after is not None and registration.applied:
        views_after = views_after.moved(registration.transform)
    surveys = (
        _with_usable_views("views_before", Survey(surfaces[0], views_before)),
        _with_usable_views("views_after", Survey(surfaces[1], views_after)),
    )
    clock.lap("registration")
    report("Fitting the mixtures", 0.25)
    problem = joint_problem(pair, registration, config)
    fits = _fit(problem, config, report)
    clock.lap("fits")
    report("Looking for changes", 0.75)
    if pair.volumetric:
        detected = _volumetric(registered, problem, fits, config)
    else:
        detected = _surface(registered, pair, fits, surveys, config)
    detected = _of_kinds(detected, config).believed(registration.confidence)
    items, labels_before, labels_after = merged(detected.before, detected.after)
    clock.lap("changes")
    report("Looking for moved objects", 0.9)
    if not pair.volumetric:
        of_working = _of_working_points(pair.before, labels_before), _of_working_points(pair.after, labels_after)
        items = with_moved(items, surveys[0].surface, surveys[1].surface, *of_working, detected.noise)
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
        diagnostics=_diagnostics((before, after), checked, pair, fits, problem, surveys, clock),
        registration=registration,
    )


def _with_usable_views(name: str, survey: Survey) -> Survey:
    """The survey, without its views where they contradict the cloud."""
    contradiction = None if survey.views is None else check_views(name, survey)
    if contradiction is None:
        return survey
    warn(contradiction)
    return Survey(survey.surface)


def _warn_about_registration(registration: Registration) -> None:
    """Warns where the registration is in doubt, with what speaks against it."""
    if not registration.in_doubt:
        return
    residual = "" if registration.residual is None else f", at a residual of {registration.residual:.3g}"
    overlap = 0.0 if registration.overlap is None else registration.overlap
    warn(
        f"the registration is in doubt (confidence {registration.confidence:.0%}), so the probabilities of all changes "
        f"are lowered: {overlap:.0%} of the points of one cloud have a counterpart in the other{residual}. Are both of "
        "the same place, in the same unit, and rotated by less than 30 degrees? crop leaves out what only one cloud "
        "has, registration='never' takes clouds that are registered already as they are"
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
    registered: tuple[Float[np.ndarray, "n0 3"], Float[np.ndarray, "n1 3"]],
    problem: JointProblem,
    fits: JointFits,
    config: DetectionConfig,
) -> _Detected:
    weights = restart_weights(fits, comparable=len(problem.points.after) <= problem.max_points)
    found = [
        volumetric_changes(points, fits, weights, kind, config.threshold)
        for points, kind in zip(registered, KINDS, strict=True)
    ]
    nothing = [np.zeros(len(points), bool) for points in registered]
    return _Detected(found[0], found[1], nothing[0], nothing[1], noise=0.0)


def _surface(
    registered: tuple[Float[np.ndarray, "n0 3"], Float[np.ndarray, "n1 3"]],
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
    found = [surface_consensus(registered[i], clouds[i].member, known[i], segments[i], usual, KINDS[i]) for i in (0, 1)]
    unobserved = [segments[i].unobserved[clouds[i].member] for i in (0, 1)]
    return _Detected(found[0], found[1], unobserved[0], unobserved[1], noise=usual.offset)


def _of_working_points(cloud: WorkingCloud, labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    working = np.empty(len(cloud.points), int)
    working[cloud.member] = labels
    return working


def _of_kinds(detected: _Detected, config: DetectionConfig) -> _Detected:
    """Without the changes of the kind that is not looked for."""
    before = _none(detected.before) if config.kinds == "appeared" else detected.before
    after = _none(detected.after) if config.kinds == "disappeared" else detected.after
    return detected._replace(before=before, after=after)


def _with_confidence(found: CloudConsensus, confidence: float) -> CloudConsensus:
    items = [dataclasses.replace(change, probability=confidence * change.probability) for change in found.items]
    return CloudConsensus(confidence * found.probability, found.labels, items)


def _none(found: CloudConsensus) -> CloudConsensus:
    return CloudConsensus(np.zeros_like(found.probability), np.full_like(found.labels, -1), [])


def _diagnostics(
    given: tuple[ArrayLike | PointCloud, ArrayLike | PointCloud],
    checked: tuple[CheckedCloud, CheckedCloud],
    pair: WorkingPair,
    fits: JointFits,
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
