"""What the joint mixture of two clouds is fitted to, with what prior: scales from the data and from the config."""

import dataclasses

import numpy as np

from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.fit.joint_mixture_model import SourcedPoints, joint_prior
from gmmjax.changes.prepare.resolution import WorkingPair
from gmmjax.changes.registration import Registration
from gmmjax.errors import InputError
from gmmjax.mixtures import FitSettings, Prior, WeightedPoints
from gmmjax.mixtures.map_fits import default_noise_floor

# Components that annihilation starts from, and points that a restart sees: on surfaces the mixture need not be fine,
# because distances see what is small.
SURFACE_COMPONENTS, VOLUME_COMPONENTS = 40, 25
SURFACE_POINTS = 6_000
POINTS_PER_COMPONENT = 20
SETTINGS = FitSettings(patience=0.02, tolerance=3e-5)
# The same fit at rest, where derivatives go through it.
AT_REST = dataclasses.replace(SETTINGS, polish=True)
# The registration tolerance of scans, in spacings.
TOLERANCE_SPACINGS = 2.0
# The scatter of voxel means on a surface, in spacings: that of a uniform distribution.
SCATTER = 12**-0.5


@dataclasses.dataclass(frozen=True)
class JointProblem:
    """A joint mixture to be fitted.

    Attributes:
        points: of both clouds, in their unit, NumPy arrays.
        prior: in that unit.
        max_components: that annihilation starts from.
        slots: of the mixture: as many for small clouds, which start from fewer components, as for large ones.
        max_points: that one fit sees.
        volumetric: whether the clouds fill volumes.
    """

    points: SourcedPoints
    prior: Prior
    max_components: int
    slots: int
    max_points: int
    volumetric: bool


def joint_problem(pair: WorkingPair, registration: Registration, config: DetectionConfig) -> JointProblem:
    """The joint mixture that a pair of aligned clouds asks for.

    Args:
        pair: both clouds, aligned.
        registration: by which they were.
        config: overrides what is derived from the data.

    Raises:
        InputError: more components than points.
    """
    clouds = pair.clouds
    points = np.concatenate([cloud.points for cloud in clouds])
    # The density of a scan is an accident of where the sensor stood: on surfaces every voxel counts the same.
    masses = [cloud.mass if pair.volumetric else np.ones(len(cloud.mass)) for cloud in clouds]
    components = _components(pair, config)
    after = np.repeat([0.0, 1.0], [len(cloud.points) for cloud in clouds])
    return JointProblem(
        points=SourcedPoints(WeightedPoints(points, np.concatenate(masses)), after),
        prior=config.over(joint_prior(_noise_floor(pair, points), _tolerance(pair, registration))),
        max_components=components,
        slots=max(components, _default_components(pair)),
        max_points=config.max_points if pair.volumetric else min(config.max_points, SURFACE_POINTS),
        volumetric=pair.volumetric,
    )


def _noise_floor(pair: WorkingPair, points: np.ndarray) -> float:
    if not pair.volumetric:
        return SCATTER * pair.spacing
    return default_noise_floor(points)


def _tolerance(pair: WorkingPair, registration: Registration) -> float:
    """The tolerance of registration grows with its residual; on surfaces it is never below the points' own scatter."""
    residual = registration.residual or 0.0
    return residual if pair.volumetric else max(TOLERANCE_SPACINGS * pair.spacing, residual)


def _components(pair: WorkingPair, config: DetectionConfig) -> int:
    points = sum(len(cloud.points) for cloud in pair.clouds)
    if config.max_components is not None:
        if config.max_components > points:
            raise InputError(
                f"max_components={config.max_components} is more than the {points} points (or voxels) of both clouds; "
                f"choose at most {max(1, points // POINTS_PER_COMPONENT)}"
            )
        return config.max_components
    return max(1, min(_default_components(pair), points // POINTS_PER_COMPONENT))


def _default_components(pair: WorkingPair) -> int:
    return VOLUME_COMPONENTS if pair.volumetric else SURFACE_COMPONENTS
