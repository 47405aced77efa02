"""Changes by one mixture for both clouds: the pipeline of the default method."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import jax
import numpy as np
from jaxtyping import Int

from gmmjax.changes.align.alignment import AlignedPair, aligned
from gmmjax.changes.candidates import Candidates, CandidateSettings, candidates_of, probability_by_difference
from gmmjax.changes.change import Change
from gmmjax.changes.detectors.aligned_scans import AlignedScans, refined, surveys_of
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.detectors.joint_diagnostics import joint_diagnostics
from gmmjax.changes.detectors.recognised_views import with_recognised_views
from gmmjax.changes.detectors.restart_detector import AbstractRestartDetector, Outcome
from gmmjax.changes.differences import DifferenceSettings, LocalDifference
from gmmjax.changes.evidence.candidate import Candidate
from gmmjax.changes.evidence.displaced_surfaces import with_both_places
from gmmjax.changes.evidence.examination import (
    EvidenceSettings,
    Examined,
    examined,
    measured_candidates,
    unexamined,
)
from gmmjax.changes.evidence.local_examination import (
    LocalExaminationSettings,
    candidates_by_resolution,
    examined_locally,
)
from gmmjax.changes.evidence.verdict_file import Verdicts, read_verdicts, shipped_verdicts
from gmmjax.changes.fit.joint_fit import (
    JointFits,
    component_excess,
    fit_joint_restarts,
    mixtures_distance,
    point_excess,
)
from gmmjax.changes.fit.joint_problem import JointFitSettings, joint_problem
from gmmjax.changes.fit.restart_fits import JOINT, RestartFits
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.changes.objects.found import Found, ObjectSettings, surfaces_found, volume_weights, volumes_found
from gmmjax.changes.objects.measures import with_measures
from gmmjax.changes.objects.moved import with_moved
from gmmjax.changes.prepare.checking import (
    CheckedCloud,
    CheckSettings,
    check_not_flat,
    check_overlap,
    check_pair,
    warn_of_outlines,
)
from gmmjax.changes.prepare.local_resolution import LocalResolutionSettings
from gmmjax.changes.prepare.resolution import ResolutionSettings, WorkingCloud
from gmmjax.changes.prepare.units import in_one_system
from gmmjax.changes.progress import Clock, silent
from gmmjax.changes.record import Changes
from gmmjax.changes.registration import Registration
from gmmjax.changes.signed_distance import SignedDistanceSettings
from gmmjax.changes.standard_errors import means_of_changes, standard_error
from gmmjax.clouds import StationSettings
from gmmjax.errors import warn
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each, each_on_cores

Rows: TypeAlias = Int[np.ndarray, " n"]
# Whether a cloud is the after cloud.
AFTER = Pair(False, True)


@dataclasses.dataclass(frozen=True)
class JointDetector(AbstractRestartDetector[AlignedScans]):
    """One mixture for both clouds, each component with its share of either; on scans with distances and evidence.

    Attributes:
        prepare: what clouds can be compared.
        common_resolution: of the voxels that both clouds are registered and fitted at.
        stations: what is a station of a scanner, in a scan without views; None: there is none.
        fit: how the mixture is fitted to both clouds.
        differences: from which distance and offset on a point of a scan is surely changed.
        candidates: which points look changed, and how they are gathered.
        evidence: when a candidate is a change.
        objects: which changes are significant, and which of them are one moved object.
        distances: how the signed distance at each point of a scan is measured.
        resolution: how small the voxels are that scans are compared in after their registration, where they have more
            points than it takes. None: they have the size that the scans were registered at, everywhere.
        examination: in what clouds candidates are examined then.
    """

    prepare: CheckSettings = CheckSettings()
    common_resolution: ResolutionSettings = ResolutionSettings()
    stations: StationSettings | None = StationSettings()
    fit: JointFitSettings = JointFitSettings()
    differences: DifferenceSettings = DifferenceSettings()
    candidates: CandidateSettings = CandidateSettings()
    evidence: EvidenceSettings = EvidenceSettings()
    objects: ObjectSettings = ObjectSettings()
    distances: SignedDistanceSettings = SignedDistanceSettings()
    resolution: LocalResolutionSettings | None = LocalResolutionSettings()
    examination: LocalExaminationSettings = LocalExaminationSettings()

    layout, fits_begin, fits_end = JOINT, 0.25, 0.75

    def restarts_of(self, prepared: AlignedScans) -> int:
        """Fewer on surfaces, where distances see what one mixture misses."""
        return self.config.number_of_restarts(on_surfaces=not prepared.volumetric)

    def slots_of(self, prepared: AlignedScans) -> int:
        """Of the joint mixture."""
        return prepared.problem.slots

    def prepared(self, scans: Pair[Scan], clock: Clock) -> AlignedScans:
        """Prepare, align."""
        # First of all, so that a file that cannot be used is told before the work.
        self._verdicts()
        return self._prepared(scans, clock)

    def _prepared(self, scans: Pair[Scan], clock: Clock) -> AlignedScans:
        clock.start("preparation", "Reading the scales of the clouds", 0.0)
        checked = check_pair(scans.map(lambda scan: scan.cloud), self.config.crop, self.prepare)
        clock.start("registration", "Registering the clouds", 0.1)
        pair = self._aligned(checked, in_one_system(scans.map(lambda scan: scan.cloud)))
        check_not_flat(pair.points, scans.map(lambda scan: scan.cloud), registered=pair.registration.applied)
        warn_of_outlines(pair.surfaces)
        problem = joint_problem(pair.working, pair.registration, self.config, self.fit)
        scans = self._with_recognised(scans, pair, checked)
        surveys, coarse = surveys_of(pair, scans, self.evidence.free_space, self.evidence.view_checks), None
        finer = self._refined(pair)
        if finer is not None:
            coarse, pair = pair.surfaces.map(lambda surface: surface.points), finer
            surveys = each(lambda own, surface: dataclasses.replace(own, surface=surface), surveys, pair.surfaces)
            surveys = each_on_cores(lambda own, points: own.sighted_by(points), surveys, pair.points)
        return AlignedScans(scans, checked, pair, coarse, surveys, problem, self.differences, self.distances)

    def _with_recognised(self, scans: Pair[Scan], pair: AlignedPair, checked: Pair[CheckedCloud]) -> Pair[Scan]:
        """The scans, with what they show themselves of where their sensors stood where nobody has told any."""
        if pair.working.volumetric:
            return scans
        points, settings = checked.map(lambda own: own.points), self.stations
        if settings is None or not self.config.recognise_stations:
            return scans
        return each_on_cores(lambda scan, own: with_recognised_views(scan, own, settings), scans, points)

    def _refined(self, pair: AlignedPair) -> AlignedPair | None:
        """The scans at their own resolution at each place; None where it is that of the registration, or was given."""
        asked, reduced = self.config.voxel_size is not None, pair.working.voxel_size is not None
        if asked or not reduced or pair.working.volumetric or self.resolution is None:
            return None
        return refined(pair, self.resolution)

    def fitted(self, prepared: AlignedScans, restarts: range, report: Callable[[float], None]) -> dict[str, np.ndarray]:
        """Fit; see `AbstractRestartDetector`."""
        problem, done = prepared.problem, iter(range(1, len(restarts) + 1))
        return fit_joint_restarts(
            prepared.framed,
            key=jax.random.key(self.config.seed),
            max_components=problem.max_components,
            slots=problem.slots,
            prior=problem.prior,
            restarts=restarts,
            max_points=problem.max_points,
            settings=self.fit.em,
            progress=lambda: report(next(done) / len(restarts)),
        )

    def found(self, prepared: AlignedScans, fits: RestartFits, clock: Clock) -> Outcome:
        """Differences, candidates, evidence, objects."""
        pair, joint = prepared.pair, JointFits.of_arrays(fits.arrays, prepared.framed.frame)
        clock.start("changes", "Looking for changes", 0.75)
        if prepared.volumetric:
            found = volumes_found(pair.points, prepared.problem, joint, self.config.threshold, self.objects.volumes)
        else:
            found = self._found_on_surfaces(prepared, joint)
        found = found.of_kinds(self.config.kinds).with_confidence(pair.registration.confidence)
        items, labels = found.merged()
        clock.start("moved", "Looking for moved objects", 0.9)
        if not prepared.volumetric and self.config.kinds == "both":
            items, labels = with_moved(items, labels, pair, found.registration_error)
            found = found.grown_to(items, labels)
        if not prepared.volumetric:
            error, measures = found.registration_error, self.objects.measures
            sides = prepared.sensors, prepared.outer_side
            items = with_measures(items, labels, pair, error, *sides, measures)
        clock.stop()
        emd, diagnostics = mixtures_distance(joint), joint_diagnostics(prepared, joint, clock)
        changes = found.record(prepared.checked, items, labels, emd, self.config, diagnostics, pair.registration)
        if not prepared.volumetric:
            changes = found.with_figures(changes, prepared.checked, prepared.figures)
        return Outcome(changes, lambda: self._standard_errors(prepared, joint, changes))

    def cut_candidates(self, scans: Pair[Scan], *, poses: Sequence[bool]) -> list[list["CutCandidates"]]:
        """The candidates of two scans with all that facts are measured from: what the verdict is learned from.

        Args:
            scans: with views.
            poses: for each set of candidates whether the views are used.

        Returns:
            For each of `poses` the candidates of both scans, those of one resolution after the other. None where the
            clouds fill volumes.
        """
        # No verdict is read: without one that has all facts there would be no way to learn it.
        prepared = self._prepared(scans, Clock(silent))
        if prepared.volumetric:
            return []
        fits = self._joint_fits(prepared)
        return [self._cut_candidates(prepared if given else prepared.without_views(), fits) for given in poses]

    def _cut_candidates(self, prepared: AlignedScans, fits: JointFits) -> list["CutCandidates"]:
        found = self._candidates(prepared, fits, prepared.observed)
        if prepared.coarse is None:
            pieces = measured_candidates(found, prepared.surveys, prepared.differences.limits, self.evidence)
            return [CutCandidates(pieces, prepared.members)]
        scene = prepared.scene(functools.partial(_of_points, fits))
        return [
            CutCandidates(level.pieces, each(_through, prepared.members, level.members))
            for level in candidates_by_resolution(found, scene, self.evidence, self.examination)
        ]

    def unpaired(self, scans: Pair[Scan]) -> "UnpairedChanges | None":
        """The changes of two scans before moved objects are looked for: what `same_object.json` is learned from.

        Args:
            scans: both clouds, with their views, where they are known.

        Returns:
            The changes; None where the clouds fill volumes.
        """
        prepared = self.prepared(scans, Clock(silent))
        if prepared.volumetric:
            return None
        pair, found = prepared.pair, self._found_on_surfaces(prepared, self._joint_fits(prepared))
        items, labels = found.with_confidence(pair.registration.confidence).merged()
        working = each(lambda own, cloud: cloud.of_working_points(own), labels, pair.working.clouds)
        return UnpairedChanges(items, working, prepared.members, pair, found.registration_error)

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
        prepared = self.prepared(scans, Clock(silent))
        if prepared.volumetric:
            return lambda labels: labels
        fits = self._joint_fits(prepared)
        found = self._candidates(prepared, fits, prepared.observed)

        def left(own: Examined, member: np.ndarray, labels: np.ndarray) -> np.ndarray:
            return np.where((member >= 0) & (own.labels[member] >= 0), labels, -1)

        def evident(labels: Pair[np.ndarray]) -> Pair[np.ndarray]:
            segments = each(_with_labels, found, prepared.members, labels)
            judged = self._examined(prepared, fits, segments)
            return each(left, judged, prepared.members, labels)

        return evident

    def _aligned(self, prepared: Pair[CheckedCloud], one_system: bool) -> AlignedPair:
        """Both clouds in one frame, with a warning where that is in doubt."""
        config, points = self.config, prepared.map(lambda cloud: cloud.points)
        pair = aligned(
            points,
            config.registration,
            config.voxel_size,
            one_system=one_system,
            seed=config.seed,
            resolution=self.common_resolution,
        )
        check_overlap(prepared, pair.registration)
        if not pair.remarked:
            _warn_about_registration(pair.registration)
        return pair

    def _joint_fits(self, prepared: AlignedScans) -> JointFits:
        """The fits of all restarts."""
        arrays = self.fitted(prepared, range(self.restarts_of(prepared)), lambda share: None)
        return JointFits.of_arrays(arrays, prepared.framed.frame)

    def _found_on_surfaces(self, prepared: AlignedScans, fits: JointFits) -> Found:
        measured, looks_changed = prepared.differences, self._candidates(prepared, fits, prepared.observed)
        if self.config.evidence:
            evident = self._examined(prepared, fits, looks_changed)
        else:
            evident = unexamined(looks_changed)
        return surfaces_found(prepared.pair, measured, evident, self.objects.surfaces)

    def _examined(self, prepared: AlignedScans, fits: JointFits, candidates: Pair[Candidates]) -> Pair[Examined]:
        verdicts, threshold = self._verdicts(), self.config.threshold
        limits, smallest = prepared.differences.limits, self.candidates.smallest_local_core
        if prepared.coarse is None:
            return examined(candidates, prepared.surveys, limits, verdicts, threshold, self.evidence)
        scene = prepared.scene(functools.partial(_of_points, fits))
        found = examined_locally(candidates, scene, verdicts, threshold, self.evidence, self.examination)
        return with_both_places(
            found, candidates, prepared.surveys, limits, smallest, self.evidence.surroundings.displacements
        )

    def _candidates(
        self, prepared: AlignedScans, fits: JointFits, observed: Pair[np.ndarray | None]
    ) -> Pair[Candidates]:
        points = prepared.pair.surfaces.map(lambda surface: surface.points)
        excess = each(lambda own, after: _of_points(fits, own, after), points, AFTER)
        sizes = prepared.pair.working.clouds.map(lambda cloud: cloud.sizes)
        outliers = each_on_cores(lambda survey: survey.outliers, prepared.surveys)
        spacings = each(
            lambda surface, size: surface.spacing(np.arange(len(surface))) if size is None else None,
            prepared.pair.surfaces,
            sizes,
        )
        return candidates_of(
            points,
            prepared.differences,
            excess,
            observed,
            self.config.threshold,
            self.candidates,
            sizes,
            outliers,
            spacings,
        )

    def _standard_errors(self, prepared: AlignedScans, joint: JointFits, changes: Changes) -> tuple[float | None, ...]:
        """Of the probability by mixture, distance and offset; in volumes of that by components."""
        if len(joint.steps) < 2 or not changes:
            return (None,) * len(changes)
        if prepared.volumetric:
            weights = volume_weights(prepared.problem, joint)
            probability = each(lambda points, after: _of_components(joint, points, after), prepared.pair.points, AFTER)
        else:
            weights = np.full(len(joint.steps), 1 / len(joint.steps))
            probability = self._looks_changed(prepared, joint)
        means = means_of_changes(probability, prepared.labels_of(changes), len(changes))
        return tuple(standard_error(means, weights).tolist())

    def _looks_changed(self, prepared: AlignedScans, fits: JointFits) -> Pair[RestartValues]:
        """For each restart the probability that each point of either cloud looks changed: its working point's."""

        def of_cloud(surface: LocalSurface, after: bool, cloud: WorkingCloud, local: LocalDifference) -> RestartValues:
            excess = _of_points(fits, surface.points, after)
            by_difference = probability_by_difference(local, prepared.differences.limits, self.candidates)

            def of(restart: int, rows: Int[np.ndarray, " m"] | slice) -> np.ndarray:
                working, place = np.unique(cloud.member[rows], return_inverse=True)
                return np.maximum(excess.of(restart, working), by_difference[working])[place]

            return RestartValues(excess.restarts, of)

        pair = prepared.pair
        return each(of_cloud, pair.surfaces, AFTER, pair.working.clouds, prepared.differences.local)

    def _verdicts(self) -> Verdicts:
        path = self.config.verdict
        return shipped_verdicts() if path is None else read_verdicts(path)


class CutCandidates(NamedTuple):
    """The candidates of two scans, cut into pieces, that are examined at one resolution.

    Attributes:
        pieces: of both scans.
        members: of each point of either scan the row in the cloud that they are pieces of, -1 for what was left out.
    """

    pieces: Pair[list[Candidate]]
    members: Pair[Rows]


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


def _of_points(fits: JointFits, points: np.ndarray, after: bool) -> RestartValues:
    """The posterior by the mixtures that each point is of what only its cloud has."""
    return RestartValues(len(fits.steps), lambda restart, rows: point_excess(fits, points[rows], after, restart))


def _through(member: Rows, further: Int[np.ndarray, " _"]) -> Rows:
    """The rows that the rows of `member` have in `further`, -1 where there is none in either."""
    return np.where(member >= 0, further[member], -1)


def _of_components(fits: JointFits, points: np.ndarray, after: bool) -> RestartValues:
    """The posterior that each point is of a component that changed."""
    return RestartValues(len(fits.steps), lambda restart, rows: component_excess(fits, points[rows], after, restart)[0])


def _with_labels(own: Candidates, member: np.ndarray, labels: np.ndarray) -> Candidates:
    """The segments of another detector as candidates: a working point is of one where any of its points is."""
    of_working = np.full(len(own.labels), -1)
    used = member >= 0
    np.maximum.at(of_working, member[used], labels[used])
    return own._replace(labels=of_working)


def _warn_about_registration(registration: Registration) -> None:
    """Warns where the registration is in doubt, with what speaks against it."""
    if not registration.in_doubt:
        return
    residual = "" if registration.residual is None else f", at a residual of {registration.residual:.3g}"
    overlap = 0.0 if registration.overlap is None else registration.overlap
    warn(
        f"the registration is in doubt (confidence {registration.confidence:.0%}), so the probabilities of all changes "
        f"are lowered: {overlap:.0%} of the points of one cloud have a counterpart in the other{residual}. Are both of "
        "the same place, in one unit of length (not longitude and latitude), and rotated by less than 30 degrees? crop "
        "leaves out what only one cloud has, registration='never' takes clouds that are registered already as they are "
        "(of DetectionConfig, --crop, --registration)"
    )
