"""Changes by one mixture for both clouds: the pipeline of the default method."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import numpy as np
from jaxtyping import Int

from gmmjax.changes.align.alignment import AlignedPair, AlignSettings, aligned
from gmmjax.changes.candidates import Candidates, CandidateSettings, candidates_of
from gmmjax.changes.change import Change, Changes
from gmmjax.changes.detectors.detector import AbstractChangeDetector, Scan
from gmmjax.changes.differences import Differences, DifferenceSettings, differences_between
from gmmjax.changes.evidence.candidate import Candidate
from gmmjax.changes.evidence.examination import (
    EvidenceSettings,
    Examined,
    examined,
    measured_candidates,
    observed_places,
    unexamined,
)
from gmmjax.changes.evidence.free_space import Survey
from gmmjax.changes.evidence.verdict_file import Verdicts, read_verdicts, shipped_verdicts
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

Rows: TypeAlias = Int[np.ndarray, " n"]


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
        # First of all, so that a file that cannot be used is told before the work.
        verdicts = self._verdicts()
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
            found = self._found_on_surfaces(pair, surveys, fits, verdicts)
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

    def cut_candidates(
        self, scans: Pair[Scan], *, poses: Sequence[bool]
    ) -> tuple[Pair[Rows], list[Pair[list[Candidate]]]]:
        """The candidates of two scans with all that facts are measured from: what the verdict is learned from.

        Args:
            scans: with views.
            poses: for each set of candidates whether the views are used.

        Returns:
            For each point of either scan the row of its working point, -1 for what was left out; for each of `poses`
            the candidates of both scans. Neither where the clouds fill volumes.
        """
        compared = self._compared(scans)
        if compared is None:
            return Pair(np.zeros(0, int), np.zeros(0, int)), []
        of_poses = []
        for given in poses:
            surveys = compared.surveys if given else compared.pair.surfaces.map(Survey)
            found = self._candidates(compared.pair, surveys, compared.fits, compared.differences)
            of_poses.append(measured_candidates(found, surveys, compared.differences.limits, self.evidence))
        return compared.members, of_poses

    def unpaired(self, scans: Pair[Scan]) -> "UnpairedChanges | None":
        """The changes of two scans before moved objects are looked for: what `same_object.json` is learned from.

        Args:
            scans: both clouds, with their views, where they are known.

        Returns:
            The changes; None where the clouds fill volumes.
        """
        compared = self._compared(scans)
        if compared is None:
            return None
        pair = compared.pair
        found = self._found_on_surfaces(pair, compared.surveys, compared.fits, self._verdicts())
        items, labels = found.with_confidence(pair.registration.confidence).merged()
        working = each(lambda own, cloud: cloud.of_working_points(own), labels, pair.working.clouds)
        return UnpairedChanges(items, working, compared.members, pair, found.registration_error)

    def evident(self, scans: Pair[Scan], labels: Pair[Int[np.ndarray, " _"]]) -> Pair[Int[np.ndarray, " _"]]:
        """What the evidence leaves of the segments of another detector, by the same facts and the same verdict as ours.

        Args:
            scans: both clouds.
            labels: per point -1 or the number of a segment.

        Returns:
            The labels, -1 where the evidence speaks against a change; as they are for clouds that fill volumes.
        """
        return self.evidence_on(scans)(labels)

    def evidence_on(self, scans: Pair[Scan]) -> Callable[[Pair[Int[np.ndarray, " _"]]], Pair[Int[np.ndarray, " _"]]]:
        """`evident` for the segments of any number of detectors: what the scans alone say is computed once.

        Args:
            scans: both clouds.
        """
        compared = self._compared(scans)
        if compared is None:
            return lambda labels: labels
        found = self._candidates(compared.pair, compared.surveys, compared.fits, compared.differences)
        limits, verdicts, threshold = compared.differences.limits, self._verdicts(), self.config.threshold

        def left(own: Examined, member: np.ndarray, labels: np.ndarray) -> np.ndarray:
            return np.where((member >= 0) & (own.labels[member] >= 0), labels, -1)

        def evident(labels: Pair[np.ndarray]) -> Pair[np.ndarray]:
            segments = each(_with_labels, found, compared.members, labels)
            judged = examined(segments, compared.surveys, limits, verdicts, threshold, self.evidence)
            return each(left, judged, compared.members, labels)

        return evident

    def _compared(self, scans: Pair[Scan]) -> "_Compared | None":
        """Both scans up to their differences; None where they fill volumes."""
        prepared = check_pair(scans.map(lambda scan: scan.cloud), self.config.crop, self.prepare)
        pair = self._aligned(prepared)
        if pair.working.volumetric:
            return None
        members = each(lambda cloud, working: cloud.to_rows(working.member, -1), prepared, pair.working.clouds)
        fits = self._fitted(joint_problem(pair.working, pair.registration, self.config, self.fit), silent)
        differences = differences_between(pair.surfaces, pair.working.spacing, self.differences)
        return _Compared(members, pair, _surveys(pair, scans, self.evidence), fits, differences)

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

    def _found_on_surfaces(
        self, pair: AlignedPair, surveys: Pair[Survey], fits: JointFits, verdicts: Verdicts
    ) -> Found:
        measured = differences_between(pair.surfaces, pair.working.spacing, self.differences)
        looks_changed = self._candidates(pair, surveys, fits, measured)
        if self.config.evidence:
            threshold = self.config.threshold
            evident = examined(looks_changed, surveys, measured.limits, verdicts, threshold, self.evidence)
        else:
            evident = unexamined(looks_changed)
        return surfaces_found(pair, measured, evident, self.objects.surfaces)

    def _candidates(
        self, pair: AlignedPair, surveys: Pair[Survey], fits: JointFits, measured: Differences
    ) -> Pair[Candidates]:
        points = pair.surfaces.map(lambda surface: surface.points)
        excess = Pair(point_excess(fits, points.before, False), point_excess(fits, points.after, True))
        observed = observed_places(points, surveys, measured)
        return candidates_of(points, measured, excess, observed, self.config.threshold, self.candidates)

    def _verdicts(self) -> Verdicts:
        path = self.config.verdict
        return shipped_verdicts() if path is None else read_verdicts(path)


class UnpairedChanges(NamedTuple):
    """The changes of two scans before moved objects are looked for.

    Attributes:
        items: the changes of both clouds.
        labels: of each working point the index of its change, or -1.
        members: of each point of either scan the row of its working point, -1 for what was left out.
        pair: both clouds, registered.
        registration_error: standard deviation of the offset between local means of one surface.
    """

    items: tuple[Change, ...]
    labels: Pair[Int[np.ndarray, " _"]]
    members: Pair[Rows]
    pair: AlignedPair
    registration_error: float


class _Compared(NamedTuple):
    """Two scans up to their differences.

    Attributes:
        members: of each point of either scan the row of its working point, -1 for what was left out.
        pair: registered.
        surveys: with the views that can be used.
        fits: the joint mixtures.
        differences: of the working points.
    """

    members: Pair[Rows]
    pair: AlignedPair
    surveys: Pair[Survey]
    fits: JointFits
    differences: Differences


def _with_labels(own: Candidates, member: np.ndarray, labels: np.ndarray) -> Candidates:
    """The segments of another detector as candidates: a working point is of one where any of its points is."""
    of_working = np.full(len(own.labels), -1)
    used = member >= 0
    np.maximum.at(of_working, member[used], labels[used])
    return own._replace(labels=of_working)


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
