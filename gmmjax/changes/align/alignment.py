"""The stage that brings both clouds into one frame, at one resolution."""

import dataclasses
import functools
import logging
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from gmmjax.changes.align.surfaces import RoughRegistration, registered_surfaces, rough_registration
from gmmjax.changes.align.volumes import registered_volumes
from gmmjax.changes.config import RegistrationMode
from gmmjax.changes.prepare.resolution import ResolutionSettings, WorkingPair, working_pair
from gmmjax.changes.registration import Registration
from gmmjax.errors import warn
from gmmjax.geometry import LocalSurface, transformed
from gmmjax.pair import Pair, parallel_map

logger = logging.getLogger(__name__)


class AlignedPair(NamedTuple):
    """Two clouds in the frame of the before cloud.

    Attributes:
        points: all points of both clouds.
        working: both at the resolution that they are compared at.
        surfaces: of the working points.
        registration: by which the after cloud was transformed.
        remarked: whether the user was warned of it already.
    """

    points: Pair[Float64[np.ndarray, "_ 3"]]
    working: WorkingPair
    surfaces: Pair[LocalSurface]
    registration: Registration
    remarked: bool = False


def aligned(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    mode: RegistrationMode = "auto",
    voxel_size: float | None = None,
    *,
    one_system: bool = False,
    seed: int = 0,
    resolution: ResolutionSettings = ResolutionSettings(),
) -> AlignedPair:
    """Registers two clouds, and reduces them to the resolution that they are compared at.

    The voxels of the after cloud are those of the frame that it is compared in: what is found does not depend on the
    frame that it was given in.

    Args:
        points: all points that are compared, in any unit.
        mode: "auto" transforms the after cloud where the fit says that it is needed, "always" whenever a transform
            is found, "never" takes the clouds as they are.
        voxel_size: edge of the voxels that are compared, in the unit of the clouds; None: from the clouds.
        one_system: whether both files state the same coordinate reference system; "auto" makes no more than a fine
            correction then.
        seed: of the mixtures that clouds that fill volumes are registered by.
        resolution: that the clouds are compared at.

    Raises:
        InputError: nothing can be compared, because one cloud is far smaller than the other's resolution.

    Warns:
        InputWarning: another alignment fits better, but not so much better that the given frame is given up; clouds of
            one reference system that were moved, or that lie apart nearly everywhere.
    """
    rough = RoughRegistration.none() if mode == "never" else rough_registration(points)
    registered = functools.partial(
        _aligned_from, points, mode=mode, voxel_size=voxel_size, one_system=one_system, seed=seed, resolution=resolution
    )
    found, remark = registered(rough, only_fine=one_system)
    # Clouds that fill volumes, but not in the voxels of the rough registration, have none.
    if rough.moves and (found.working.volumetric or not found.registration.applied):
        confidence = 1.0 if found.working.volumetric else found.registration.confidence
        found, other = registered(RoughRegistration.none(), only_fine=True)
        remark = remark or other
        confidence = min(confidence, found.registration.confidence)
        found = found._replace(registration=dataclasses.replace(found.registration, confidence=confidence))
    if remark is not None:
        warn(remark)
    _log(found.working, found.registration)
    return found._replace(remarked=remark is not None)


def _aligned_from(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    rough: RoughRegistration,
    *,
    mode: RegistrationMode,
    voxel_size: float | None,
    one_system: bool,
    only_fine: bool,
    seed: int,
    resolution: ResolutionSettings,
) -> tuple[AlignedPair, str | None]:
    """The clouds aligned from a rough registration, and what a user has to know of it."""
    remark = None
    roughly = Pair(points.before, transformed(points.after, rough.transform)) if rough.moves else points
    pair = working_pair(roughly, voxel_size, resolution)
    surfaces = parallel_map(lambda cloud: LocalSurface.of(cloud.points, tree=cloud.tree), pair.clouds)
    if pair.volumetric:
        registration = registered_volumes(points, pair, surfaces, mode, seed)
    else:
        registration, remark = registered_surfaces(
            pair.spacing, surfaces, rough, mode, one_system=one_system, only_fine=only_fine
        )
    if not registration.applied:
        return AlignedPair(points, pair, surfaces, registration), remark
    return _with_transform(points, pair, surfaces, rough, registration), remark


def _log(pair: WorkingPair, registration: Registration) -> None:
    kind, compared = "volumes" if pair.volumetric else "surfaces", pair.clouds.map(lambda cloud: len(cloud.points))
    size = "none" if pair.voxel_size is None else f"{pair.voxel_size:.4g}"
    text = "compared as %s: %d and %d points, voxel size %s, spacing %.4g"
    logger.info(text, kind, compared.before, compared.after, size, pair.spacing)
    about = {name: value for name, value in registration.to_dict().items() if name != "transform"}
    logger.info("registration: %s", ", ".join(f"{name} {_shown(value)}" for name, value in about.items()))


def _shown(value: float | bool | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower()


def _with_transform(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    pair: WorkingPair,
    surfaces: Pair[LocalSurface],
    rough: RoughRegistration,
    registration: Registration,
) -> AlignedPair:
    registered = Pair(points.before, registration.apply(points.after))
    if pair.voxel_size is not None:
        pair = pair.with_after_of(registered.after)
        surfaces = Pair(surfaces.before, LocalSurface.of(pair.clouds.after.points))
        return AlignedPair(registered, pair, surfaces, registration)
    # What is left to be transformed after the rough registration.
    left = registration.transform @ np.linalg.inv(rough.transform)
    surfaces = Pair(surfaces.before, surfaces.after.moved(left))
    return AlignedPair(registered, pair.with_after(surfaces.after.points), surfaces, registration)
