"""Registration of clouds that fill volumes: the displacement on which most components of their mixtures agree."""

import jax
import numpy as np
from jaxtyping import Float64

from gmmjax.changes.align.component_displacement import consensus_displacement
from gmmjax.changes.align.confidence import ConfidenceModel
from gmmjax.changes.align.mixing import Mixing
from gmmjax.changes.align.surface_fit import random_sample, surface_fit
from gmmjax.changes.config import RegistrationMode
from gmmjax.changes.prepare.resolution import WorkingCloud, WorkingPair
from gmmjax.changes.registration import Registration
from gmmjax.geometry import LocalSurface, rigid_transform
from gmmjax.mixtures import FitSettings, GaussianMixture, best_fit, fit_restarts
from gmmjax.pair import Pair, each


def registered_volumes(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    pair: WorkingPair,
    surfaces: Pair[LocalSurface],
    mode: RegistrationMode,
    seed: int,
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
    """
    centre = surfaces.after.points.mean(axis=0, keepdims=True)
    if mode == "never":
        fit = surface_fit(surfaces, np.eye(4), pair.spacing)
        return Registration.measured(
            np.eye(4), centre, applied=False, residual=0.0, residual_before=fit.residual, overlap=fit.overlap
        )
    mixtures = _mixtures(pair.clouds, seed)
    counts = pair.clouds.map(lambda cloud: float(len(cloud.points)))
    consensus = consensus_displacement(mixtures.before, mixtures.after, counts.before, counts.after)
    errors = float(np.linalg.norm(consensus.displacement / consensus.standard_error))
    transform, mixing = rigid_transform(translation=consensus.displacement), Mixing.of(points)
    agreed = consensus.share >= 0.4
    significant = errors > 4 and mixing.better(transform, np.eye(4)) > 0
    applied = agreed and (mode == "always" or significant)
    # Fewer components, or of fewer points, do not show whether they agree.
    judged = min(mixture.live.sum() for mixture in mixtures) >= 3
    judged &= min(len(cloud.points) for cloud in pair.clouds) >= 1_000
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


def _mixtures(clouds: Pair[WorkingCloud], seed: int) -> Pair[GaussianMixture]:
    return each(_mixture, clouds, Pair(*jax.random.split(jax.random.key(seed), 2)))


def _mixture(cloud: WorkingCloud, key: jax.Array) -> GaussianMixture:
    points = cloud.points[random_sample(len(cloud.points), 6_000)]
    fits = fit_restarts(
        points,
        key=key,
        max_components=max(1, min(25, len(points) // 10)),
        restarts=2,
        settings=FitSettings(patience=0.05),
    )
    return best_fit(fits).mixture
