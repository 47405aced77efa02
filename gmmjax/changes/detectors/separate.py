"""Changes by a mixture for each cloud, compared by optimal transport: what the thesis's detectors have in common."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import jax
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax._host import to_numpy
from gmmjax._programs import lru_jit
from gmmjax._typing import Array, Scalar
from gmmjax.changes.change import Kind
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.detectors.count_significance import SIGNIFICANCE, count_significance
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.detectors.restart_detector import AbstractRestartDetector, Outcome
from gmmjax.changes.fit.restart_fits import (
    SEPARATE,
    RestartFits,
    mixture_arrays,
    mixture_of,
    of_restarts,
    status_array,
    status_of,
)
from gmmjax.changes.objects.cloud_changes import CloudChanges
from gmmjax.changes.objects.consensus import cloud_consensus, component_labels, votes_of_pairs
from gmmjax.changes.objects.pair_changes import KINDS, PairChanges
from gmmjax.changes.prepare.checking import NAMES
from gmmjax.changes.prepare.separate_clouds import PreparedCloud, PreparedPair, prepare_pair
from gmmjax.changes.progress import Clock
from gmmjax.changes.record import Changes
from gmmjax.changes.standard_errors import means_of_pairs, standard_error_of_pairs
from gmmjax.comparison import FIT_SETTINGS, Decision, Method, Strengths, compare_mixtures
from gmmjax.errors import ComputationError
from gmmjax.mixtures import Fit, FitSettings, FitStatus, GaussianMixture, Prior, default_noise_floor, failed, fits_of
from gmmjax.pair import Pair, each
from gmmjax.transport import GroundCost, TransportStatus, earth_movers_distance

Compared = tuple[Bool[Array, "r0 r1 k0"], Bool[Array, "r0 r1 k1"], Float[Array, "r0 r1"], Bool[Array, "r0 r1"]]
"""For each pair of restarts which Gaussians changed, the earth mover's distance, and whether it could be compared."""

# The numbers of a fit that are kept as they are.
SCORES = ("message_length", "log_likelihood", "steps", "bits", "noise_share")


def over_pairs(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of two mixtures for every pair of restarts."""
    return jax.vmap(jax.vmap(function, in_axes=(None, 0)), in_axes=(0, None))


class PreparedScans(NamedTuple):
    """Two scans, and what is fitted to them.

    Attributes:
        scans: as they were given.
        pair: filtered and reduced.
    """

    scans: Pair[Scan]
    pair: PreparedPair


class _Votes(NamedTuple):
    """Votes of the pairs of restarts.

    Attributes:
        by_pairs: for each restart of the other cloud, own restart and Gaussian whether it changed.
        valid: for each restart of the before and of the after cloud whether they could be compared.
        emd: earth mover's distance, mean over the pairs.
    """

    by_pairs: Pair[Bool[np.ndarray, "other own k"]]
    valid: Bool[np.ndarray, "r0 r1"]
    emd: float

    def where(self, believed: Pair[Bool[np.ndarray, "own k"]]) -> "_Votes":
        """The votes for the Gaussians in whose place a cloud has significantly more points than the other.

        The mixtures differ between restarts, and between samples of one scene; a change must show in the counts, too.
        """
        return self._replace(by_pairs=each(lambda votes, own: votes & own[None], self.by_pairs, believed))

    @property
    def changed(self) -> Pair[Float[np.ndarray, "own k"]]:
        """For each restart and Gaussian the share of the other cloud's restarts by which it changed."""
        return each(votes_of_pairs, self.by_pairs, self.solved)

    @property
    def solved(self) -> Pair[Bool[np.ndarray, "other own"]]:
        """True where the transport problems of a pair of restarts were solved, for either cloud as the own one."""
        return Pair(self.valid.T, self.valid)


@dataclasses.dataclass(frozen=True)
class AbstractSeparateDetector(AbstractRestartDetector[PreparedScans]):
    """Each cloud is fitted from several random starts, and every pair of restarts is compared by optimal transport.

    Points and Gaussians get the mean of the votes as probability.

    Attributes:
        slots: the mixtures are compared in as few slots as they fit in: programs compile for these numbers only, and
            for K_max. (): always K_max.
        fit: how either cloud is fitted.
        block: number of restarts of either cloud that are compared at a time, all of their pairs side by side: a bound
            on the memory. Results do not depend on it.
        ground_cost: between the components of two mixtures; None: that of the method, see `Decision`.
        method: by which two mixtures are compared.
    """

    slots: tuple[int, ...] = (8, 16)
    fit: FitSettings = FIT_SETTINGS["greedy"]
    block: int = 8
    ground_cost: GroundCost | None = None

    method: ClassVar[Method]
    layout, fits_begin, fits_end = SEPARATE, 0.15, 0.8

    def compare(self, mixtures: Pair[GaussianMixture], points: Pair[float]) -> Compared:
        """Compares every pair of restarts.

        Args:
            mixtures: of both clouds, with a leading axis of restarts, in float64.
            points: observations in either cloud.
        """
        decision = Decision(self.method, self.config.kinds, ground_cost=self.ground_cost)
        strengths = Strengths(self.config.penalty if self.method == "transport" else None)
        given = mixtures.before, mixtures.after, points.before, points.after, strengths
        compared: Compared = _compared_pairs(*given, decision=decision, threshold=self.config.threshold)
        return compared

    def prepared(self, scans: Pair[Scan], clock: Clock) -> PreparedScans:
        """Check, filter, reduce."""
        clock.start("preparation", "Filtering the points", 0.0)
        return PreparedScans(scans, prepare_pair(scans.map(lambda scan: scan.cloud), self.config))

    def restarts_of(self, prepared: PreparedScans) -> int:
        """The number of restarts of either cloud."""
        return self.config.number_of_restarts()

    def slots_of(self, prepared: PreparedScans) -> int:
        """The number of slots of the mixture of either cloud."""
        return prepared.pair.max_components

    def fitted(
        self, prepared: PreparedScans, restarts: range, report: Callable[[float], None]
    ) -> dict[str, np.ndarray]:
        """Fit each cloud; see `AbstractRestartDetector`."""
        pair, done = prepared.pair, iter(range(1, 2 * len(restarts) + 1))
        key = jax.random.key(self.config.seed)
        keys = [jax.random.fold_in(key, restart) for restart in restarts]
        both = fits_of(
            list(pair.clouds.map(lambda cloud: cloud.weighted)),
            # The same starts for both, whichever is the earlier one: equal clouds have equal mixtures.
            [keys, keys],
            max_components=pair.max_components,
            prior=_prior(pair, self.config),
            starts=None,
            settings=self.fit,
            precision="float64",
            devices=None,
            progress=lambda: report(next(done) / (2 * len(restarts))),
        )
        return {
            f"{name}_{time}": own for time, fit in zip(NAMES, both, strict=True) for name, own in _arrays(fit).items()
        }

    def found(self, prepared: PreparedScans, fits: RestartFits, clock: Clock) -> Outcome:
        """Compare every pair of restarts, label the points."""
        pair, mixed = prepared.pair, each(_finite, NAMES, _fits_of_clouds(fits))
        clock.start("comparison", "Comparing the mixtures", 0.8)
        mixtures = self._compacted(mixed, pair.max_components)
        significance = each(self._significance, mixtures, pair.clouds, pair.clouds.swapped)
        votes = self._votes(mixtures, pair).where(significance.map(lambda own: own >= SIGNIFICANCE))
        clock.start("labels", "Labelling the points", 0.9)
        found = PairChanges(
            each(self._cloud_changes, pair.clouds, mixtures, mixed, votes.changed, significance, KINDS),
            pair.clouds.map(lambda cloud: np.zeros(len(cloud.points), bool)),
        )
        items, labels = found.merged()
        clock.stop()
        diagnostics = _diagnostics(prepared, len(fits), mixed, votes, clock)
        changes = found.record(pair.clouds, items, labels, votes.emd, self.config, diagnostics)
        return Outcome(changes, lambda: self._standard_errors(pair, mixtures, votes, changes))

    def _compacted(self, fits: Pair[Fit], max_components: int) -> Pair[GaussianMixture]:
        """The mixtures of all restarts in the smallest common number of slots."""
        most = max(int(fit.mixture.live.sum(axis=1).max()) for fit in fits)
        slots = next((slots for slots in self.slots if most <= slots <= max_components), max_components)
        with jax.enable_x64(True):
            compacted = jax.vmap(lambda mixture: mixture.compacted(slots))
            return fits.map(lambda fit: jax.tree.map(np.asarray, compacted(fit.mixture)))

    def _votes(self, mixtures: Pair[GaussianMixture], pair: PreparedPair) -> _Votes:
        """Every pair of restarts."""
        points = pair.clouds.map(lambda cloud: float(cloud.weighted.mass.sum()))
        changed_before, changed_after, emd, valid = self._compared(mixtures, points)
        if not valid.any():
            raise ComputationError("no pair of restarts could be compared: the transport problems were not solved")
        return _Votes(Pair(changed_before.swapaxes(0, 1), changed_after), valid, float(emd[valid].mean()))

    def _compared(self, mixtures: Pair[GaussianMixture], points: Pair[float]) -> list[np.ndarray]:
        """`compare` for some restarts of either cloud at a time, filled up to that number."""
        restarts = mixtures.map(lambda mixture: len(mixture.weights))
        blocks = each(lambda mixture: _blocks(mixture, self.block), mixtures)
        rows = []
        with jax.enable_x64(True):
            for before in blocks.before:
                compared = [to_numpy(self.compare(Pair(before, after), points)) for after in blocks.after]
                rows.append([np.concatenate(parts, axis=1) for parts in zip(*compared, strict=True)])
        whole = [np.concatenate(parts) for parts in zip(*rows, strict=True)]
        return [part[: restarts.before, : restarts.after] for part in whole]

    def _standard_errors(
        self, pair: PreparedPair, mixtures: Pair[GaussianMixture], votes: _Votes, changes: Changes
    ) -> tuple[float | None, ...]:
        """The standard errors of the votes, over the restarts of both clouds."""
        if min(votes.valid.any(axis=1).sum(), votes.valid.any(axis=0).sum()) < 2:
            return (None,) * len(changes)
        labels = each(
            lambda own, cloud: own[cloud.rows], Pair(changes.labels_before, changes.labels_after), pair.clouds
        )
        components = each(lambda cloud, own: component_labels(cloud.points, own), pair.clouds, mixtures)
        means = each(
            lambda own, label, voted: means_of_pairs(own, label, len(changes), voted),
            components,
            labels,
            votes.by_pairs,
        )
        # Each change is one of one of the clouds.
        errors = each(standard_error_of_pairs, means, votes.solved)
        return tuple(np.maximum(errors.before, errors.after).tolist())

    def _significance(self, mixtures: GaussianMixture, own: PreparedCloud, other: PreparedCloud) -> np.ndarray:
        """The significance of the excess of each Gaussian's points over what the other cloud has in its place."""
        return count_significance(mixtures, own.counted, other.counted)

    def _cloud_changes(
        self,
        own: PreparedCloud,
        mixtures: GaussianMixture,
        fits: Fit,
        votes: np.ndarray,
        significance: np.ndarray,
        kind: Kind,
    ) -> CloudChanges:
        """The changes of one cloud, by the votes for its Gaussians."""
        reference = int(np.argmin(fits.message_length))
        return cloud_consensus(own.points, mixtures, votes, significance, reference, kind, self.config.threshold)


@lru_jit
def _compared_pairs(
    before: GaussianMixture,
    after: GaussianMixture,
    points_before: Scalar,
    points_after: Scalar,
    strengths: Strengths,
    *,
    decision: Decision,
    threshold: float,
) -> Compared:
    def compare(before: GaussianMixture, after: GaussianMixture) -> tuple[JaxArray, JaxArray, JaxArray, JaxArray]:
        found = compare_mixtures(before, after, points_before, points_after, decision, strengths, threshold)
        solved = found.result == TransportStatus.optimal
        # That of partial transport is by the shape of the Gaussians, too; what is told is the thesis's.
        emd = found.emd if decision.method == "greedy" else earth_movers_distance(before, after).cost
        return found.changed_before > threshold, found.changed_after > threshold, emd, solved

    return over_pairs(compare)(before, after)


def _blocks(mixtures: GaussianMixture, size: int) -> list[GaussianMixture]:
    """The restarts in blocks of this size, the last one filled up with its last restart; or all of fewer."""
    restarts = len(mixtures.weights)
    if restarts <= size:
        return [mixtures]
    rows = np.minimum(np.arange(restarts + -restarts % size), restarts - 1)
    return [jax.tree.map(lambda leaf, own=own: leaf[own], mixtures) for own in np.split(rows, len(rows) // size)]


def _prior(pair: PreparedPair, config: DetectionConfig) -> Prior | None:
    """The prior that the config sets; None: nothing is set."""
    settings = (config.noise_floor, config.concentration, config.covariance_scale, config.noise_share)
    if all(setting is None for setting in settings):
        return None
    points = np.concatenate([cloud.weighted.points for cloud in pair.clouds])
    return dataclasses.replace(config.over(Prior.figueiredo_jain(3, default_noise_floor(points))), tolerance=0.0)


def _finite(name: str, fits: Fit) -> Fit:
    finite = ~np.asarray(failed(fits.result))
    if not finite.any():
        raise ComputationError(f"{name}: no restart gave a mixture; raise noise_floor")
    kept: Fit = jax.tree.map(lambda leaf: leaf[finite], fits)
    return kept


def _arrays(fit: Fit) -> dict[str, np.ndarray]:
    """The arrays of the fits of one cloud, as in `RestartFits`."""
    scores = {name: getattr(fit, name) for name in SCORES}
    return {**mixture_arrays(fit.mixture), **scores, "result": status_array(fit.result)}


def _fits_of_clouds(fits: RestartFits) -> Pair[Fit]:
    """The fits of both clouds with a leading axis of restarts."""
    return NAMES.map(lambda time: _fits_of_cloud(fits, time))


def _fits_of_cloud(fits: RestartFits, time: str) -> Fit:
    own = {name.removesuffix(f"_{time}"): part for name, part in fits.arrays.items() if name.endswith(f"_{time}")}
    return of_restarts(_fit, own)


def _fit(arrays: Mapping[str, np.ndarray]) -> Fit:
    scores = {name: arrays[name] for name in SCORES}
    return Fit(mixture=mixture_of(arrays), result=status_of(arrays["result"]), **scores)


def _diagnostics(
    prepared: PreparedScans, restarts: int, fits: Pair[Fit], votes: _Votes, clock: Clock
) -> dict[str, Any]:
    """Plain values for the record and the report."""
    pair = prepared.pair
    clouds = each(lambda *of_cloud: _cloud_diagnostics(restarts, *of_cloud), prepared.scans, pair.clouds, fits)
    return {
        "before": clouds.before,
        "after": clouds.after,
        "voxel_size": pair.voxel_size,
        "max_components": pair.max_components,
        "pairs_of_restarts": votes.valid.size,
        "pairs_solved": int(votes.valid.sum()),
        "seconds": dict(clock.seconds),
        "device": jax.devices()[0].device_kind,
        "precision": "float64",
    }


def _cloud_diagnostics(restarts: int, scan: Scan, cloud: PreparedCloud, fits: Fit) -> dict[str, Any]:
    return {
        **cloud.diagnostics(scan.cloud),
        "outliers": cloud.outliers,
        "points_fitted": len(cloud.weighted.mass),
        "restarts_failed": restarts - len(fits.steps),
        "components": fits.mixture.live.sum(axis=1).tolist(),
        "message_length": np.round(fits.message_length, 3).tolist(),
        "steps": fits.steps.tolist(),
        "converged": np.asarray(fits.result == FitStatus.converged).tolist(),
    }


@dataclasses.dataclass(frozen=True)
class GreedyDetector(AbstractSeparateDetector):
    """The thesis's detector: every pair of restarts by Algorithm 1, the removals that bring both closest (2.2.4)."""

    method: ClassVar[Method] = "greedy"


@dataclasses.dataclass(frozen=True)
class TransportDetector(AbstractSeparateDetector):
    """Every pair of restarts by partial transport of point counts: the mass that it leaves unmatched changed."""

    method: ClassVar[Method] = "transport"
