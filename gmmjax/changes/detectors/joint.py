"""Changes by one mixture for both clouds: the pipeline of the default method."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes.align.alignment import AlignedPair, aligned
from gmmjax.changes.candidates import Candidates, CandidateSettings, candidates_of, probability_by_difference
from gmmjax.changes.detectors.aligned_scans import AlignedScans, refined, surveys_of
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.detectors.joint_diagnostics import joint_diagnostics
from gmmjax.changes.detectors.recognised_views import with_recognised_views
from gmmjax.changes.detectors.restart_detector import AbstractRestartDetector, Outcome
from gmmjax.changes.differences import DifferenceSettings
from gmmjax.changes.evidence.displaced_surfaces import pair_displaced_surfaces
from gmmjax.changes.evidence.examination import EvidenceSettings, Examined, examined, unexamined
from gmmjax.changes.evidence.local_examination import LocalExaminationSettings, examined_locally
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
from gmmjax.changes.objects.measures import measure_changes
from gmmjax.changes.objects.moved import match_moved_objects
from gmmjax.changes.objects.pair_changes import PairChanges, changes_in_volumes, changes_on_surfaces, volume_weights
from gmmjax.changes.objects.surface_changes import SurfaceChangeSettings
from gmmjax.changes.prepare.checking import (
    CheckedCloud,
    CheckSettings,
    check_not_flat,
    check_overlap,
    check_pair,
    warn_of_outlines,
)
from gmmjax.changes.prepare.local_resolution import LocalResolutionSettings
from gmmjax.changes.prepare.resolution import ResolutionSettings
from gmmjax.changes.prepare.units import in_one_system
from gmmjax.changes.progress import Clock
from gmmjax.changes.record import Changes
from gmmjax.changes.registration import Registration
from gmmjax.changes.signed_distance import SignedDistanceSettings
from gmmjax.changes.standard_errors import means_of_changes, standard_error
from gmmjax.clouds import StationSettings
from gmmjax.errors import warn
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each, parallel_map

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
        objects: how probable the points of changes are.
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
    objects: SurfaceChangeSettings = SurfaceChangeSettings()
    distances: SignedDistanceSettings = SignedDistanceSettings()
    resolution: LocalResolutionSettings | None = LocalResolutionSettings()
    examination: LocalExaminationSettings = LocalExaminationSettings()

    layout, fits_begin, fits_end = JOINT, 0.25, 0.75

    def restarts_of(self, prepared: AlignedScans) -> int:
        """The number of restarts: fewer on surfaces, where distances see what one mixture misses."""
        return self.config.number_of_restarts(on_surfaces=not prepared.volumetric)

    def slots_of(self, prepared: AlignedScans) -> int:
        """The number of slots of the joint mixture."""
        return prepared.problem.slots

    def prepared(self, scans: Pair[Scan], clock: Clock) -> AlignedScans:
        """Check, align, reduce."""
        # First of all, so that a file that cannot be used is told before the work.
        self._verdicts()
        return self.aligned_scans(scans, clock)

    def aligned_scans(self, scans: Pair[Scan], clock: Clock) -> AlignedScans:
        """Check both scans, bring them into one frame, and reduce them to the resolution that they are compared at.

        Args:
            scans: at the earlier and at the later time, in one unit.
            clock: is told of the stages.
        """
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
            coarse, pair = pair.surfaces.map(_points_of), finer
            surveys = each(lambda own, surface: dataclasses.replace(own, surface=surface), surveys, pair.surfaces)
            surveys = parallel_map(lambda own, points: own.with_line_of_sight(points), surveys, pair.points)
        return AlignedScans(scans, checked, pair, coarse, surveys, problem, self.differences, self.distances)

    def _with_recognised(self, scans: Pair[Scan], pair: AlignedPair, checked: Pair[CheckedCloud]) -> Pair[Scan]:
        """The scans, with what they show themselves of where their sensors stood where nobody has told any."""
        if pair.working.volumetric:
            return scans
        points, settings = checked.map(lambda own: own.points), self.stations
        if settings is None or not self.config.recognise_stations:
            return scans
        return parallel_map(lambda scan, own: with_recognised_views(scan, own, settings), scans, points)

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
            found = changes_in_volumes(pair.points, prepared.problem, joint, self.config.threshold)
        else:
            found = self.found_on_surfaces(prepared, joint)
        found = found.of_kinds(self.config.kinds).with_confidence(pair.registration.confidence)
        items, labels = found.merged()
        clock.start("moved", "Looking for moved objects", 0.9)
        if not prepared.volumetric:
            error = found.registration_error
            if self.config.kinds == "both":
                items, labels = match_moved_objects(items, labels, pair, error)
                found = found.grown_to(items, labels)
            sides = prepared.sensors, prepared.outer_side
            items = measure_changes(items, labels, pair, error, *sides)
        clock.stop()
        emd, diagnostics = mixtures_distance(joint), joint_diagnostics(prepared, joint, clock)
        changes = found.record(prepared.checked, items, labels, emd, self.config, diagnostics, pair.registration)
        if not prepared.volumetric:
            changes = found.with_figures(changes, prepared.checked, prepared.figures)
        return Outcome(changes, lambda: self._standard_errors(prepared, joint, changes))

    def found_on_surfaces(self, prepared: AlignedScans, fits: JointFits) -> PairChanges:
        """Find the changes of scans before moved objects are looked for.

        Args:
            prepared: both scans.
            fits: of all restarts.
        """
        candidates = self.candidates_in(prepared, fits)
        evident = self.examined(prepared, fits, candidates) if self.config.evidence else unexamined(candidates)
        return changes_on_surfaces(prepared.pair, prepared.differences, evident, self.objects)

    def joint_fits(self, prepared: AlignedScans) -> JointFits:
        """Fit all restarts.

        Args:
            prepared: both scans.
        """
        arrays = self.fitted(prepared, range(self.restarts_of(prepared)), lambda share: None)
        return JointFits.of_arrays(arrays, prepared.framed.frame)

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

    def candidates_in(self, prepared: AlignedScans, fits: JointFits) -> Pair[Candidates]:
        """Gather the points of both scans that look changed.

        Args:
            prepared: both scans.
            fits: of all restarts.
        """
        surfaces = prepared.pair.surfaces
        points, sizes = surfaces.map(_points_of), prepared.pair.working.clouds.map(lambda cloud: cloud.sizes)
        return candidates_of(
            points,
            prepared.differences,
            each(functools.partial(posterior_of_points, fits), points, AFTER),
            prepared.observed,
            self.config.threshold,
            self.candidates,
            sizes,
            parallel_map(lambda survey: survey.outliers, prepared.surveys),
            each(
                lambda surface, size: surface.spacing(np.arange(len(surface))) if size is None else None,
                surfaces,
                sizes,
            ),
        )

    def examined(self, prepared: AlignedScans, fits: JointFits, candidates: Pair[Candidates]) -> Pair[Examined]:
        """Classify the candidates by the evidence of both scans.

        Args:
            prepared: both scans.
            fits: of all restarts.
            candidates: in them.
        """
        verdicts, threshold = self._verdicts(), self.config.threshold
        limits, smallest = prepared.differences.limits, self.candidates.smallest_local_core
        if prepared.coarse is None:
            return examined(candidates, prepared.surveys, limits, verdicts, threshold, self.evidence)
        scene = prepared.scene(functools.partial(posterior_of_points, fits))
        found = examined_locally(candidates, scene, verdicts, threshold, self.evidence, self.examination)
        displacements = self.evidence.surroundings.displacements
        return pair_displaced_surfaces(found, candidates, prepared.surveys, limits, smallest, displacements)

    def _standard_errors(self, prepared: AlignedScans, joint: JointFits, changes: Changes) -> tuple[float | None, ...]:
        """The standard errors of the probability by mixture, distance and offset; in volumes of that by components."""
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
        pair, limits = prepared.pair, prepared.differences.limits
        mixture = each(functools.partial(posterior_of_points, fits), pair.surfaces.map(_points_of), AFTER)
        by_difference = prepared.differences.local.map(
            lambda local: probability_by_difference(local, limits, self.candidates)
        )
        return each(_values_of_members, mixture, by_difference, pair.working.clouds.map(lambda cloud: cloud.member))

    def _verdicts(self) -> Verdicts:
        path = self.config.verdict
        return shipped_verdicts() if path is None else read_verdicts(path)


def posterior_of_points(fits: JointFits, points: Float[np.ndarray, "n 3"], after: bool) -> RestartValues:
    """The posterior by each joint mixture that each point is of what only its cloud has.

    Args:
        fits: of all restarts.
        points: of one cloud.
        after: whether it is the after cloud.
    """
    return RestartValues(len(fits.steps), lambda restart, rows: point_excess(fits, points[rows], after, restart))


def _values_of_members(
    mixture: RestartValues, by_difference: Float[np.ndarray, " m"], member: Int[np.ndarray, " n"]
) -> RestartValues:
    """The greater of what the mixture and the difference say of each point's working point."""
    return RestartValues(mixture.restarts, functools.partial(_values_at, mixture, by_difference, member))


def _values_at(
    mixture: RestartValues,
    by_difference: Float[np.ndarray, " m"],
    member: Int[np.ndarray, " n"],
    restart: int,
    rows: Int[np.ndarray, " k"] | slice,
) -> Float[np.ndarray, " k"]:
    working, place = np.unique(member[rows], return_inverse=True)
    return np.asarray(np.maximum(mixture.of(restart, working), by_difference[working])[place])


def _points_of(surface: LocalSurface) -> Float[np.ndarray, "n 3"]:
    return surface.points


def _of_components(fits: JointFits, points: np.ndarray, after: bool) -> RestartValues:
    """The posterior that each point is of a component that changed."""
    return RestartValues(len(fits.steps), lambda restart, rows: component_excess(fits, points[rows], after, restart)[0])


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
