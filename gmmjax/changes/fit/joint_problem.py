"""What the joint mixture of two clouds is fitted to, with what prior: scales from the data and from the config."""

import dataclasses
import logging

import numpy as np

from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.prepare.resolution import WorkingPair
from gmmjax.changes.registration import Registration
from gmmjax.comparison import FIT_SETTINGS, LabelledPoints, joint_prior
from gmmjax.errors import InputError
from gmmjax.mixtures import FitSettings, Prior, WeightedPoints, default_noise_floor

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class JointFitSettings:
    """How the joint mixture is fitted.

    Attributes:
        surface_components: that annihilation starts from on surfaces: the mixture need not be fine, because distances
            see what is small.
        volume_components: the same of clouds that fill volumes.
        surface_points: that a restart sees on surfaces, at most.
        points_per_component: of small clouds: with fewer points fewer components are started from.
        em: how EM runs.
        tolerance_spacings: least registration tolerance of scans, in spacings. 0: two samples of one surface differ.
        scatter_spacings: noise floor on surfaces, in spacings: the standard deviation of voxel means along an axis,
            which is that of a uniform distribution.
    """

    surface_components: int = 40
    volume_components: int = 25
    surface_points: int = 6_000
    points_per_component: int = 20
    em: FitSettings = FIT_SETTINGS["joint"]
    tolerance_spacings: float = 2.0
    scatter_spacings: float = 12**-0.5

    @property
    def at_rest(self) -> FitSettings:
        """EM polished to a fixed point, where derivatives go through the fit."""
        return dataclasses.replace(self.em, polish=True)


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

    points: LabelledPoints
    prior: Prior
    max_components: int
    slots: int
    max_points: int
    volumetric: bool


def joint_problem(
    pair: WorkingPair,
    registration: Registration,
    config: DetectionConfig,
    settings: JointFitSettings = JointFitSettings(),
) -> JointProblem:
    """The joint mixture that a pair of aligned clouds asks for.

    Args:
        pair: both clouds, aligned.
        registration: by which they were.
        config: overrides what is derived from the data.
        settings: how what is derived from the data is derived.

    Raises:
        InputError: more components than points.
    """
    clouds = pair.clouds
    points = np.concatenate([cloud.points for cloud in clouds])
    # The density of a scan is an accident of where the sensor stood: on surfaces every voxel counts the same.
    masses = [cloud.mass if pair.volumetric else np.ones(len(cloud.mass)) for cloud in clouds]
    components = _components(pair, config, settings)
    after = np.repeat([0.0, 1.0], [len(cloud.points) for cloud in clouds])
    prior = config.over(joint_prior(_noise_floor(pair, points, settings), _tolerance(pair, registration, settings)))
    logger.info("joint mixture: at most %d components, tolerance %.4g", components, float(prior.tolerance))
    return JointProblem(
        points=LabelledPoints(WeightedPoints(points, np.concatenate(masses)), after),
        prior=prior,
        max_components=components,
        slots=max(components, _default_components(pair, settings)),
        max_points=config.max_points if pair.volumetric else min(config.max_points, settings.surface_points),
        volumetric=pair.volumetric,
    )


def _noise_floor(pair: WorkingPair, points: np.ndarray, settings: JointFitSettings) -> float:
    if not pair.volumetric:
        return settings.scatter_spacings * pair.spacing
    return default_noise_floor(points)


def _tolerance(pair: WorkingPair, registration: Registration, settings: JointFitSettings) -> float:
    """The tolerance of registration grows with its residual; on surfaces it is never below the points' own scatter."""
    residual = registration.residual or 0.0
    return residual if pair.volumetric else max(settings.tolerance_spacings * pair.spacing, residual)


def _components(pair: WorkingPair, config: DetectionConfig, settings: JointFitSettings) -> int:
    points = sum(len(cloud.points) for cloud in pair.clouds)
    if config.max_components is not None:
        if config.max_components > points:
            raise InputError(
                f"max_components={config.max_components} is more than the {points} points (or voxels) of both clouds; "
                f"choose at most {max(1, points // settings.points_per_component)}"
            )
        return config.max_components
    return max(1, min(_default_components(pair, settings), points // settings.points_per_component))


def _default_components(pair: WorkingPair, settings: JointFitSettings) -> int:
    return settings.volume_components if pair.volumetric else settings.surface_components
