"""Changes by one mixture for both clouds: the pipeline of the default method."""

import dataclasses
from typing import Any

import jax
import numpy as np

from gmmjax.changes.align.alignment import AlignedPair, AlignSettings, aligned
from gmmjax.changes.candidates import CandidateSettings, candidates_of
from gmmjax.changes.change import Changes
from gmmjax.changes.detectors.detector import AbstractChangeDetector, Scan
from gmmjax.changes.differences import DifferenceSettings, differences_between
from gmmjax.changes.evidence.examination import EvidenceSettings, examined, unexamined
from gmmjax.changes.evidence.free_space import Survey
from gmmjax.changes.evidence.view_checks import usable_views
from gmmjax.changes.fit.joint_fit import JointFits, fit_joint_restarts, mixtures_distance, point_excess
from gmmjax.changes.fit.joint_problem import JointFitSettings, JointProblem, joint_problem
from gmmjax.changes.objects.found import Found, ObjectSettings, surfaces_found, volumes_found
from gmmjax.changes.objects.moved import with_moved
from gmmjax.changes.prepare.checking import NAMES, CheckedCloud, CheckSettings, check_overlap, check_pair
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.changes.progress import Clock, Progress, silent
from gmmjax.changes.registration import Registration
from gmmjax.clouds import SensorViews
from gmmjax.errors import warn
from gmmjax.geometry import LocalSurface
from gmmjax.mixtures import FitStatus
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class JointDetector(AbstractChangeDetector):
    """One mixture for both clouds, each component with its share of either; on scans with distances and evidence.

    Attributes:
        prepare: what clouds can be compared.
        align: how the clouds are brought into one frame.
        fit: how the mixture is fitted to both clouds.
        differences: from which distance and offset on a point of a scan is surely changed.
        candidates: which points look changed, and how they are gathered.
        evidence: when a candidate is a change.
        objects: which changes are significant, and which of them are one moved object.
    """

    prepare: CheckSettings = CheckSettings()
    align: AlignSettings = AlignSettings()
    fit: JointFitSettings = JointFitSettings()
    differences: DifferenceSettings = DifferenceSettings()
    candidates: CandidateSettings = CandidateSettings()
    evidence: EvidenceSettings = EvidenceSettings()
    objects: ObjectSettings = ObjectSettings()

    def changes(self, scans: Pair[Scan], report: Progress = silent) -> Changes:
        """What changed: prepare, align, fit, differences, candidates, evidence, objects."""
        clock = Clock(report)
        clock.start("preparation", "Reading the scales of the clouds", 0.0)
        prepared = check_pair(scans.map(lambda scan: scan.cloud), self.config.crop, self.prepare)
        clock.start("registration", "Registering the clouds", 0.1)
        pair = self._aligned(prepared)
        surveys = _surveys(pair, scans, self.evidence)
        clock.start("fits", "Fitting the mixtures", 0.25)
        problem = joint_problem(pair.working, pair.registration, self.config, self.fit)
        fits = self._fitted(problem, report)
        clock.start("changes", "Looking for changes", 0.75)
        if pair.working.volumetric:
            found = volumes_found(pair.points, problem, fits, self.config.threshold, self.objects.volumes)
        else:
            found = self._found_on_surfaces(pair, surveys, fits)
        found = found.of_kinds(self.config.kinds).with_confidence(pair.registration.confidence)
        items, labels = found.merged()
        clock.start("moved", "Looking for moved objects", 0.9)
        if not pair.working.volumetric and self.config.kinds == "both":
            items, labels = with_moved(items, labels, pair, found.registration_error, self.objects.moved)
            found = found.grown_to(items, labels)
        clock.finish()
        diagnostics = _diagnostics(scans, prepared, pair, fits, problem, surveys, clock)
        return found.record(
            prepared, items, labels, mixtures_distance(fits), self.config, diagnostics, pair.registration
        )

    def _aligned(self, prepared: Pair[CheckedCloud]) -> AlignedPair:
        """Both clouds in one frame, with a warning where that is in doubt."""
        config, points = self.config, prepared.map(lambda cloud: cloud.points)
        pair = aligned(points, config.registration, config.voxel_size, seed=config.seed, settings=self.align)
        check_overlap(prepared, pair.registration)
        _warn_about_registration(pair.registration)
        return pair

    def _fitted(self, problem: JointProblem, report: Progress) -> JointFits:
        restarts = self.config.number_of_restarts(on_surfaces=not problem.volumetric)
        done = iter(range(1, restarts + 1))
        return fit_joint_restarts(
            problem.points,
            key=jax.random.key(self.config.seed),
            max_components=problem.max_components,
            slots=problem.slots,
            prior=problem.prior,
            restarts=restarts,
            max_points=problem.max_points,
            settings=self.fit.em,
            progress=lambda: report("Fitting the mixtures", 0.25 + 0.5 * next(done) / restarts),
        )

    def _found_on_surfaces(self, pair: AlignedPair, surveys: Pair[Survey], fits: JointFits) -> Found:
        points = pair.surfaces.map(lambda surface: surface.points)
        excess = Pair(point_excess(fits, points.before, False), point_excess(fits, points.after, True))
        measured = differences_between(pair.surfaces, pair.working.spacing, self.differences)
        looks_changed = candidates_of(points, measured, excess, self.config.threshold, self.candidates)
        if self.config.evidence:
            evident = examined(looks_changed, surveys, measured.limits, self.evidence)
        else:
            evident = unexamined(looks_changed)
        return surfaces_found(pair, measured, evident, self.objects.surfaces)


def _surveys(pair: AlignedPair, scans: Pair[Scan], settings: EvidenceSettings) -> Pair[Survey]:
    """Both clouds with their views in the before frame, where these do not contradict them."""
    views = scans.map(lambda scan: scan.views)
    if views.after is not None and pair.registration.applied:
        views = Pair(views.before, views.after.moved(pair.registration.transform))

    def survey(name: str, surface: LocalSurface, views: SensorViews | None) -> Survey:
        return usable_views(f"views_{name}", Survey(surface, views, settings.free_space), settings.view_checks)

    return each(survey, NAMES, pair.surfaces, views)


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


def _diagnostics(
    scans: Pair[Scan],
    prepared: Pair[CheckedCloud],
    pair: AlignedPair,
    fits: JointFits,
    problem: JointProblem,
    surveys: Pair[Survey],
    clock: Clock,
) -> dict[str, Any]:
    """Plain values for the record and the report."""
    clouds = each(_cloud_diagnostics, scans, prepared, pair.working.clouds, surveys.map(lambda survey: survey.views))
    return {
        "before": clouds.before,
        "after": clouds.after,
        "voxel_size": pair.working.voxel_size,
        "spacing": pair.working.spacing,
        "volumetric": pair.working.volumetric,
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
    scan: Scan, cloud: CheckedCloud, working: WorkingCloud, views: SensorViews | None
) -> dict[str, Any]:
    return {
        **cloud.diagnostics(scan.cloud),
        "points_compared": len(working.points),
        "views": 0 if views is None else len(views),
    }
