"""Recording of one survey of a scene: measured and true positions of points, and the solids that they belong to."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews, voxel_grid, voxel_size_for
from gmmjax.geometry import rotation_about, transformed
from gmmjax.pair import Pair, each
from gmmjax.scenes.ray_casting import Solid, cast
from gmmjax.scenes.rigid_motions import small_motion


@dataclasses.dataclass(frozen=True)
class PoseErrors:
    """Errors of the stated poses of a survey.

    Attributes:
        jitter: standard deviation of the translation of each pose on its own, metres.
        jitter_degrees: the same of its rotation.
        drift: translation at the end of the path, metres; it grows along the path.
        drift_degrees: the same of the rotation, about the place of the first pose.
    """

    jitter: float = 0.0
    jitter_degrees: float = 0.0
    drift: float = 0.0
    drift_degrees: float = 0.0

    def believed(self, poses: Float[np.ndarray, "v 4 4"], random: np.random.Generator) -> Float[np.ndarray, "v 4 4"]:
        """The poses with these errors."""
        axis, direction = (vector / np.linalg.norm(vector) for vector in random.standard_normal((2, 3)))
        shares = np.linspace(0.0, 1.0, len(poses)) if len(poses) > 1 else np.zeros(1)
        start, believed = poses[0, :3, 3], []
        for pose, share in zip(poses, shares, strict=True):
            rotation = Rotation.from_rotvec(share * np.radians(self.drift_degrees) * axis).as_matrix()
            drifted = rotation_about(rotation, start, start + share * self.drift * direction) @ pose
            shift, degrees = np.abs(random.standard_normal(2)) * (self.jitter, self.jitter_degrees)
            jitter, place = small_motion(random, shift, degrees), drifted[:3, 3]
            believed.append(rotation_about(jitter[:3, :3], place, place + jitter[:3, 3]) @ drifted)
        return np.stack(believed)


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One survey.

    Attributes:
        points: as recorded, with the errors of the poses [n, 3], metres.
        places: where they were measured in truth, noise included [n, 3].
        labels: of the solids that they belong to.
        views: where the sensor believed to stand.
        stands: where it stood.
        min_elevation: a turning scanner does not measure lower than this, degrees.
    """

    points: Float[np.ndarray, "n 3"]
    places: Float[np.ndarray, "n 3"]
    labels: Int[np.ndarray, " n"]
    views: SensorViews
    stands: SensorViews
    min_elevation: float = -90.0

    def chosen(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> "Recording":
        """With these points alone."""
        return dataclasses.replace(self, points=self.points[rows], places=self.places[rows], labels=self.labels[rows])

    def thinned(self, most: int, random: np.random.Generator) -> "Recording":
        """With at most this number of points, drawn at random."""
        if len(self.points) <= most:
            return self
        return self.chosen(np.sort(random.choice(len(self.points), most, replace=False)))

    def fused(self, voxel: float) -> "Recording":
        """The means of the points in voxels of this edge, metres; each belongs to what most of its points belong to."""
        grid = voxel_grid(self.points, voxel)
        numbers = np.unique(self.labels)
        count = len(grid.mass)
        votes = [np.bincount(grid.voxel_of_point, self.labels == number, minlength=count) for number in numbers]
        sums = [np.bincount(grid.voxel_of_point, axis, minlength=count) for axis in self.places.T]
        places = np.stack(sums, axis=1) / grid.mass[:, None]
        return dataclasses.replace(self, points=grid.points, places=places, labels=numbers[np.argmax(votes, axis=0)])

    def fused_to(self, most: int) -> "Recording":
        """Fused in voxels of the size that leaves about this number of points, where it has more."""
        return self if len(self.points) <= most else self.fused(voxel_size_for(self.points, most))

    def saw(
        self, places: Float[np.ndarray, "m 3"], solids: Sequence[Solid], hidden_by: float
    ) -> Bool[np.ndarray, " m"]:
        """Mask of the places that `seen` calls observed from the sensor's poses, among the solids of its survey."""
        return seen(places, solids, self.stands, hidden_by=hidden_by, min_elevation=self.min_elevation)


def seen(
    points: Float[np.ndarray, "n 3"],
    solids: Sequence[Solid],
    views: SensorViews,
    *,
    hidden_by: float = 0.03,
    min_elevation: float = -90.0,
) -> Bool[np.ndarray, " n"]:
    """Mask of the points in the free space, or on the surfaces, that a survey observes.

    Args:
        points: in the world, metres.
        solids: of the scene.
        views: poses and field of view of the survey's camera or scanner.
        hidden_by: a point is occluded when the first hit on its ray is nearer than the point by more than this, metres.
        min_elevation: a turning scanner does not measure lower than this, degrees.
    """
    min_sine = np.sin(np.radians(min_elevation))
    visible = np.zeros(len(points), bool)
    for view in range(len(views)):
        places = views.in_camera(points, view)
        sensed = -places[:, 1] >= min_sine * np.linalg.norm(places, axis=1) if views.turning else places[:, 2] > 0
        candidates = np.flatnonzero(views.in_field_of_view(places) & sensed & ~visible)
        position = views.poses[view, :3, 3]
        rays = points[candidates] - position
        ranges = np.linalg.norm(rays, axis=1)
        first_hit, _ = cast(solids, position, rays / ranges[:, None])
        visible[candidates[first_hit > ranges - hidden_by]] = True
    return visible


def joined(
    frames: Sequence[tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, " _"]]],
    poses: Float[np.ndarray, "v 4 4"],
    believed: Float[np.ndarray, "v 4 4"],
    field_of_view: tuple[float, float],
    max_range: float,
    min_elevation: float = -90.0,
) -> Recording:
    """The recording of a sensor that measured once from each pose.

    Args:
        frames: points in true coordinates, and labels, of each pose.
        poses: where the sensor stood.
        believed: where it believed to stand: its points are displaced with it.
        field_of_view: full horizontal and vertical angle, degrees.
        max_range: of the sensor, metres.
        min_elevation: a turning scanner does not measure lower than this, degrees.
    """
    displaced = [
        transformed(points, there @ np.linalg.inv(pose))
        for (points, _), pose, there in zip(frames, poses, believed, strict=True)
    ]
    places, labels = (np.concatenate(own) for own in zip(*frames, strict=True))
    views, stands = (SensorViews(own, field_of_view, max_range) for own in (believed, poses))
    return Recording(np.concatenate(displaced), places, labels, views, stands, min_elevation)


def drawn_density(
    random: np.random.Generator,
    recordings: Pair[Recording],
    *,
    most: tuple[int, int] = (12_000, 40_000),
    least: int = 5_000,
    fused: float = 0.7,
) -> Pair[Recording]:
    """The recordings fused in voxels or thinned, half of the time to densities of up to ten to one.

    Args:
        random: of everything.
        recordings: of the two surveys.
        most: between how many points the denser one has, where it has so many.
        least: that the other one keeps.
        fused: share of the clouds that are fused in voxels; the others keep points drawn at random.
    """
    points = int(random.uniform(*most))
    ratio = float(np.exp(random.uniform(0, np.log(10)))) if random.random() < 0.5 else 1.0
    counts = (points, max(least, int(points / ratio)))
    ordered = Pair(*(counts if random.random() < 0.5 else counts[::-1]))
    fuses = Pair(*random.random(2) < fused)
    return each(
        lambda own, count, fuse: own.fused_to(count) if fuse else own.thinned(count, random), recordings, ordered, fuses
    )
