"""Artificial scenes: clouds drawn from Gaussians, of which some are gone and some are new (thesis 3.1.2 and 4.6.1)."""

import dataclasses
from typing import Literal, get_args

import jax
import numpy as np
from jaxtyping import Float, Int, PRNGKeyArray

from gmmjax.errors import InputError
from gmmjax.mixtures import GaussianMixture

Overlap = Literal["low", "medium"]
OVERLAPS: tuple[Overlap, ...] = get_args(Overlap)

# Thesis 4.6.1: the means are uniform in a cube of this half width, the principal variances in this range (metres).
HALF_WIDTH: dict[Overlap, float] = {"low": 4.0, "medium": 2.0}
PRINCIPAL_VARIANCES = (0.01, 0.1)


@dataclasses.dataclass(frozen=True)
class GaussianScene:
    """A pair of clouds with the truth.

    Attributes:
        before: the cloud at the first time [n0, 3], metres.
        after: the cloud at the second time [n1, 3], drawn anew also from the Gaussians that stayed.
        truth_before: per point -1 where its Gaussian stayed, else the number of the change that it belongs to.
        truth_after: the same for `after`; appeared Gaussians are numbered on from the disappeared ones.
        gaussians_before: per point the number of the Gaussian that it was drawn from; one that stayed has the same
            number in both clouds.
        gaussians_after: the same for `after`.
        mixture_before: the Gaussians that `before` was drawn from.
        mixture_after: the Gaussians that `after` was drawn from.
    """

    before: Float[np.ndarray, "n0 3"]
    after: Float[np.ndarray, "n1 3"]
    truth_before: Int[np.ndarray, " n0"]
    truth_after: Int[np.ndarray, " n1"]
    gaussians_before: Int[np.ndarray, " n0"]
    gaussians_after: Int[np.ndarray, " n1"]
    mixture_before: GaussianMixture
    mixture_after: GaussianMixture


def random_scene(
    key: PRNGKeyArray,
    *,
    start: int = 5,
    appeared: int = 1,
    disappeared: int = 0,
    overlap: Overlap = "low",
    points: int = 1000,
    density: float = 1.0,
    shift: float = 0.0,
) -> GaussianScene:
    """A random scene of thesis 4.6.1.

    Args:
        key: random key; the same key gives the same scene.
        start: Gaussians in the before cloud.
        appeared: new Gaussians in the after cloud.
        disappeared: Gaussians of the before cloud that are not in the after cloud.
        overlap: "low" has the means in [-4, 4] m, "medium" in [-2, 2] m.
        points: points drawn from each Gaussian.
        density: of the after cloud, by that of the before cloud.
        shift: standard deviation on each axis of a displacement of the whole after cloud, metres.

    Raises:
        InputError: numbers that leave a cloud without a Gaussian or without points, or an unknown overlap.
    """
    _check(overlap, start, points, density, shift)
    if min(appeared, disappeared) < 0:
        raise InputError("appeared and disappeared must be at least 0")
    if disappeared > start or start - disappeared + appeared < 1:
        raise InputError(f"disappeared={disappeared} of start={start} leaves no Gaussian in one of the clouds")
    random = numpy_generator(key)
    total = start + appeared
    means = random.uniform(-HALF_WIDTH[overlap], HALF_WIDTH[overlap], (total, 3))
    covariances = _random_covariances(random, total)
    counts = points, _after_points(points, density)
    return _shifted(random, _scene(random, means, covariances, start, disappeared, counts), shift)


def replaced_scene(
    key: PRNGKeyArray,
    *,
    separation: float,
    start: int = 5,
    overlap: Overlap = "low",
    points: int = 1000,
    density: float = 1.0,
    shift: float = 0.0,
) -> GaussianScene:
    """A random scene in which one Gaussian is gone and a new one stands near its place, as in thesis figure 4.8.

    The new Gaussian has a random covariance of its own. It stands in a random direction from the one that is gone.

    Args:
        key: random key; the same key gives the same scene.
        separation: distance of the two means, in root mean square standard deviations of the Gaussian that is gone.
        start: Gaussians in either cloud.
        overlap: as of `random_scene`, like the next three.
        points: from each Gaussian.
        density: of the after cloud.
        shift: of the after cloud.

    Raises:
        InputError: as `random_scene`.
    """
    _check(overlap, start, points, density, shift)
    if not 0 <= separation < np.inf:
        raise InputError(f"separation={separation!r} must be at least 0")
    random = numpy_generator(key)
    means = random.uniform(-HALF_WIDTH[overlap], HALF_WIDTH[overlap], (start + 1, 3))
    covariances = _random_covariances(random, start + 1)
    direction = random.standard_normal(3)
    deviation = np.sqrt(np.trace(covariances[0]) / 3)
    means[start] = means[0] + separation * deviation * direction / np.linalg.norm(direction)
    counts = points, _after_points(points, density)
    return _shifted(random, _scene(random, means, covariances, start, 1, counts), shift)


def fixed_scene(key: PRNGKeyArray, *, points: int = 1000) -> GaussianScene:
    """The scene of thesis 3.1.2 and figure 3.2: four Gaussians, then three more.

    Two of the added Gaussians intersect with one that was there, the third stands apart. The thesis gives no numbers;
    these are chosen after its figure.

    Args:
        key: random key of the points.
        points: points drawn from each Gaussian.
    """
    x, y, z = (0, 2, 0.5, -1.5, 0.4, 2.3, 2.5), (0, 0.5, 2, 1, 0.3, 0.2, 2.5), (0, 0, 0.5, 1, 0.3, 0.4, 2.5)
    means = np.array([x, y, z], float).T
    diagonals = np.array([[10, 5, 8, 4, 3, 8, 5], [5, 10, 3, 6, 9, 2, 5], [5, 4, 6, 10, 2, 9, 10]]).T / 100
    return _scene(numpy_generator(key), means, diagonals[:, :, None] * np.eye(3), 4, 0, (points, points))


def _scene(
    random: np.random.Generator,
    means: Float[np.ndarray, "k 3"],
    covariances: Float[np.ndarray, "k 3 3"],
    start: int,
    disappeared: int,
    counts: tuple[int, int],
) -> GaussianScene:
    """The first `start` Gaussians are in `before`; the first `disappeared` of them are not in `after`."""
    before = np.arange(start)
    after = np.arange(disappeared, len(means))
    # The numbers of the changes: the disappeared Gaussians first, then the appeared ones.
    change = np.full(len(means), -1)
    changed = np.concatenate([before[:disappeared], np.arange(start, len(means))])
    change[changed] = np.arange(len(changed))
    return GaussianScene(
        before=_draw(random, means[before], covariances[before], counts[0]),
        after=_draw(random, means[after], covariances[after], counts[1]),
        truth_before=np.repeat(change[before], counts[0]),
        truth_after=np.repeat(change[after], counts[1]),
        gaussians_before=np.repeat(before, counts[0]),
        gaussians_after=np.repeat(after, counts[1]),
        mixture_before=_equal_mixture(means[before], covariances[before]),
        mixture_after=_equal_mixture(means[after], covariances[after]),
    )


def _shifted(random: np.random.Generator, scene: GaussianScene, shift: float) -> GaussianScene:
    """The scene with its after cloud displaced at random."""
    displacement = shift * random.standard_normal(3)
    mixture = scene.mixture_after
    moved = GaussianMixture(mixture.weights, mixture.means + displacement, mixture.covariances, mixture.live)
    return dataclasses.replace(scene, after=scene.after + displacement, mixture_after=moved)


def _check(overlap: str, start: int, points: int, density: float, shift: float) -> None:
    if overlap not in OVERLAPS:
        raise InputError(f"overlap={overlap!r} is unknown; choose from {', '.join(OVERLAPS)}")
    if min(start, points) < 1:
        raise InputError("start and points must be at least 1")
    if not 0 < density < np.inf:
        raise InputError(f"density={density!r} must be a positive number")
    if not 0 <= shift < np.inf:
        raise InputError(f"shift={shift!r} must be a length of at least 0")


def _after_points(points: int, density: float) -> int:
    return max(1, round(points * density))


def _draw(
    random: np.random.Generator, means: Float[np.ndarray, "k 3"], covariances: Float[np.ndarray, "k 3 3"], points: int
) -> Float[np.ndarray, "n 3"]:
    standard = random.standard_normal((len(means), points, 3))
    factors = np.linalg.cholesky(covariances)
    return (means[:, None] + standard @ factors.transpose(0, 2, 1)).reshape(-1, 3)


def _equal_mixture(means: Float[np.ndarray, "k 3"], covariances: Float[np.ndarray, "k 3 3"]) -> GaussianMixture:
    count = len(means)
    return GaussianMixture(np.full(count, 1 / count), means, covariances, np.ones(count, bool))


def _random_covariances(random: np.random.Generator, count: int) -> Float[np.ndarray, "k 3 3"]:
    """Uniform principal variances about uniformly random axes."""
    axes, triangle = np.linalg.qr(random.standard_normal((count, 3, 3)))
    axes = axes * np.sign(np.diagonal(triangle, axis1=1, axis2=2))[:, None, :]
    return np.einsum("kij,kj,klj->kil", axes, random.uniform(*PRINCIPAL_VARIANCES, (count, 3)), axes)


def numpy_generator(key: PRNGKeyArray) -> np.random.Generator:
    """NumPy's generator, in float64 whatever JAX's setting, seeded with the bits of a JAX key."""
    return np.random.default_rng(np.asarray(jax.random.key_data(key)).tolist())
