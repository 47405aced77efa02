"""Registration of clouds that fill volumes: the displacement on which most components of their mixtures agree."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float64

from gmmjax.changes.align.component_displacement import DisplacementSettings, consensus_displacement
from gmmjax.changes.align.confidence import ConfidenceModel
from gmmjax.changes.align.mixing import Mixing
from gmmjax.changes.align.surface_fit import random_sample, surface_fit
from gmmjax.changes.config import RegistrationMode
from gmmjax.changes.prepare.resolution import WorkingCloud, WorkingPair
from gmmjax.changes.registration import Registration
from gmmjax.geometry import LocalSurface, rigid_transform
from gmmjax.mixtures import FitSettings, GaussianMixture, best_fit, fit_restarts
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class VolumeRegistrationSettings:
    """When a displacement of volumetric clouds is applied, and the mixtures that it is found from.

    Attributes:
        significant: it has this many standard errors. 0: any displacement is applied.
        least_agreement: the components that agree on it have this fraction of the mass.
        least_components: with fewer in either mixture it says nothing whether they agree.
        least_points: with fewer in either cloud the components are too uncertain for that, too.
        components: of each mixture, at most.
        component_points: that these are fitted to.
        displacement: when components agree on a displacement.
    """

    significant: float = 4.0
    least_agreement: float = 0.4
    least_components: int = 3
    least_points: int = 1_000
    components: int = 25
    component_points: int = 6_000
    displacement: DisplacementSettings = DisplacementSettings()


def registered_volumes(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    pair: WorkingPair,
    surfaces: Pair[LocalSurface],
    mode: RegistrationMode,
    seed: int,
    settings: VolumeRegistrationSettings = VolumeRegistrationSettings(),
) -> Registration:
    """The displacement on which most components agree, where it exceeds its standard error; none with "never".

    With "auto" the given frame is kept where it mixes the clouds as well. It is certain where it mixes them as two
    samples of one density and nothing near it is better, whatever the components say: those of trees agree on nothing.

    Args:
        points: all points of both clouds.
        pair: both clouds at the working resolution.
        surfaces: the same.
        mode: whether to register.
        seed: of the mixtures' random starts.
        settings: when the displacement is applied.
    """
    centre = surfaces.after.points.mean(axis=0, keepdims=True)
    if mode == "never":
        fit = surface_fit(surfaces, np.eye(4), pair.spacing)
        return Registration.measured(
            np.eye(4), centre, applied=False, residual=0.0, residual_before=fit.residual, overlap=fit.overlap
        )
    mixtures = _mixtures(pair.clouds, seed, settings)
    counts = pair.clouds.map(lambda cloud: float(len(cloud.points)))
    consensus = consensus_displacement(
        mixtures.before, mixtures.after, counts.before, counts.after, settings.displacement
    )
    errors = float(np.linalg.norm(consensus.displacement / consensus.standard_error))
    transform, mixing = rigid_transform(translation=consensus.displacement), Mixing.of(points)
    agreed = consensus.share >= settings.least_agreement
    significant = errors > settings.significant and mixing.better(transform, np.eye(4)) > 0
    applied = agreed and (mode == "always" or significant)
    judged = min(mixture.live.sum() for mixture in mixtures) >= settings.least_components
    judged &= min(len(cloud.points) for cloud in pair.clouds) >= settings.least_points
    overlap, confidence = consensus.share, ConfidenceModel().of_agreement(consensus.share) if judged else 1.0
    if not applied:
        certain = mixing.confidence()
        if certain >= confidence or (judged and not agreed):
            overlap, confidence = mixing.share(np.eye(4)), certain
    return Registration.measured(
        transform if applied else np.eye(4),
        centre,
        applied=applied,
        residual=float(np.sqrt((consensus.standard_error**2).mean())) if applied else 0.0,
        residual_before=float(np.linalg.norm(consensus.displacement)) if agreed else 0.0,
        overlap=overlap,
        confidence=confidence,
    )


def _mixtures(clouds: Pair[WorkingCloud], seed: int, settings: VolumeRegistrationSettings) -> Pair[GaussianMixture]:
    def mixture(cloud: WorkingCloud, key: jax.Array) -> GaussianMixture:
        points = cloud.points[random_sample(len(cloud.points), settings.component_points)]
        fits = fit_restarts(
            points,
            key=key,
            max_components=max(1, min(settings.components, len(points) // 10)),
            restarts=2,
            settings=FitSettings(patience=0.05),
        )
        return best_fit(fits).mixture

    return each(mixture, clouds, Pair(*jax.random.split(jax.random.key(seed), 2)))
