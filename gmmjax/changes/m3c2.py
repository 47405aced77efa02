r"""The distance between two clouds along a normal, and its level of detection: M3C2 (Lague, Brodu and Leroux 2013).

About a core point, the points of either cloud in a cylinder along the normal are projected to it. With the means
$\mu$, standard deviations $\sigma$ (of n - 1) and numbers n of the projections, and the registration error r, the
distance is $d = \mu_2 - \mu_1$, and the level of detection at 95 %, equation (1),

$$\mathrm{LoD} = 1.96 \left( \sqrt{\sigma_1^2 / n_1 + \sigma_2^2 / n_2} + r \right).$$
"""

import dataclasses

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Float64, Int

from gmmjax.changes.cylinders import Cylinders, Projections, projections
from gmmjax.clouds import as_finite_points
from gmmjax.errors import InputError
from gmmjax.pair import Pair, each, parallel_map

Lengths = float | Float[np.ndarray, " n"]
"""A length for all core points, or one for each, in the unit of the clouds."""


@dataclasses.dataclass(frozen=True, eq=False)
class M3C2Settings:
    """The cylinder about each core point, and from when on a distance counts as detected.

    Attributes:
        radius: of the cylinder, in the unit of the clouds: one for all core points, or one for each. Small: few points
            to average over; large: what is smaller than it is averaged away.
        depth: half length of the cylinder, likewise; a `Pair` where it is longer in one of the clouds. Short: a surface
            that moved further is not found; long: another surface behind it is mixed in.
        standard_errors: from which on a distance is detected; 1.96 is 95 % of a normal distribution. 0: the level of
            detection is 0 everywhere.
    """

    radius: Lengths
    depth: Lengths | Pair[Lengths]
    standard_errors: float = 1.96

    @property
    def reach(self) -> float:
        """The distance from a core point up to which points may be in its cylinder."""
        depths = tuple(self.depth) if isinstance(self.depth, Pair) else (self.depth,)
        return max(float(np.hypot(self.radius, depth).max()) for depth in depths)


@dataclasses.dataclass(frozen=True, eq=False)
class M3C2Distances:
    """The M3C2 distance of each core point; lengths in the unit of the clouds.

    Attributes:
        distance: from the before to the after cloud, positive on the side that the normal points to; NaN where the
            cylinder has no point of one of the clouds.
        level_of_detection: a distance beyond it is significant at 95 %; NaN where the cylinder has fewer than two
            points of one of the clouds.
        significance: the absolute distance in standard errors: above 1.96 it is beyond the level of detection. Infinite
            where the standard error is 0 and the distance is not; NaN as the level of detection is.
        spread: standard deviation of the projections of either cloud's points, NaN for fewer than two.
        count: number of either cloud's points in the cylinder.
    """

    distance: Float64[np.ndarray, " n"]
    level_of_detection: Float64[np.ndarray, " n"]
    significance: Float64[np.ndarray, " n"]
    spread: Pair[Float64[np.ndarray, " n"]]
    count: Pair[Int[np.ndarray, " n"]]


def m3c2_distances(
    core_points: npt.ArrayLike,
    normals: npt.ArrayLike,
    clouds: Pair[npt.ArrayLike],
    settings: M3C2Settings,
    registration_error: Lengths = 0.0,
) -> M3C2Distances:
    """The signed distances between two registered clouds at core points, with their levels of detection.

    Computed in float64, from coordinates that are subtracted first: those of a country's grid lose nothing.

    Args:
        core_points: finite coordinates [N, 3].
        normals: the direction of each core point's cylinder [N, 3], or one for all [1, 3], of any length but 0.
        clouds: finite coordinates [M, 3] of both clouds; either may be without points.
        settings: radius and depth of the cylinders.
        registration_error: standard deviation, in the unit of the clouds: one for all core points, or one for each.

    Raises:
        InputError: coordinates that are not finite, a normal of length 0, a radius or a depth that is not positive, a
            negative registration error, or arrays of another length.
    """
    core = as_finite_points(core_points, "core_points")
    points = each(as_finite_points, clouds, Pair("clouds.before", "clouds.after"))
    axes, radius = _unit(normals, len(core)), _lengths(settings.radius, "radius", len(core))
    depth = settings.depth if isinstance(settings.depth, Pair) else Pair(settings.depth, settings.depth)
    cylinders = depth.map(lambda own: Cylinders(core, axes, radius, _lengths(own, "depth", len(core))))
    error = _lengths(registration_error, "registration_error", len(core), positive=False)
    return _compared(parallel_map(projections, points, cylinders), error, settings.standard_errors)


def _compared(sides: Pair[Projections], error: Float64[np.ndarray, " n"], standard_errors: float) -> M3C2Distances:
    distance = sides.after.mean - sides.before.mean
    # NaN where there are no points.
    with np.errstate(divide="ignore", invalid="ignore"):
        of_means = sides.map(lambda side: side.variance / side.count)
        standard_error = np.sqrt(of_means.before + of_means.after) + error
        significance = np.where(distance == 0, 0 * standard_error, np.abs(distance) / standard_error)
    spread = sides.map(lambda side: np.sqrt(side.variance))
    count = sides.map(lambda side: side.count)
    return M3C2Distances(distance, standard_errors * standard_error, significance, spread, count)


def _lengths(values: Lengths, name: str, count: int, positive: bool = True) -> Float64[np.ndarray, " n"]:
    """One length for each core point."""
    lengths = np.asarray(values, np.float64)
    if lengths.shape not in ((), (count,)):
        raise InputError(f"{name}: must be one number, or one for each of {count} core points, not {lengths.shape}")
    if not (np.isfinite(lengths) & ((lengths > 0) | (not positive and lengths == 0))).all():
        wanted = "positive" if positive else "0 or positive"
        raise InputError(f"{name}: must be {wanted} and finite; give it in the unit of the clouds")
    return np.broadcast_to(lengths, (count,))


def _unit(normals: npt.ArrayLike, count: int) -> Float64[np.ndarray, "n 3"]:
    """One normal of length 1 for each core point."""
    given = as_finite_points(normals, "normals")
    if len(given) not in (1, count):
        raise InputError(f"normals: must be one, or one for each of {count} core points, not {len(given)}")
    lengths = np.linalg.norm(given, axis=1, keepdims=True)
    if not (lengths > 0).all():
        row = int(np.flatnonzero(lengths[:, 0] <= 0)[0])
        raise InputError(f"normals: row {row} is 0 and has no direction; leave that core point out")
    return np.broadcast_to(given / lengths, (count, 3))
