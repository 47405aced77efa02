"""The cells that the volume between two surfaces is summed over: a DEM of difference in the plane of the change."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy import ndimage
from scipy.spatial import cKDTree

from gmmjax.geometry import evenly_chosen, nearest_neighbours, within_box
from gmmjax.pair import Pair, each

# Edge of a cell in point spacings. Points at random lie in as many cells beyond an outline as they miss within it;
# larger cells make a change wider than it is.
CELL = 1.25
# Half-width of a 95 % interval in standard errors.
QUANTILE = 1.96
# Points by which a spacing is measured, and cells, at most: bounds on time and memory.
SAMPLE, MAX_CELLS = 1000, 1_000_000
SQUARE = np.ones((3, 3), bool)
RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], float)


def spacing_of(points: Float64[np.ndarray, "n 3"]) -> float:
    """Spacing of points on a surface, of which k fill a disc of k spacings squared; 0 for fewer than two."""
    count = min(16, len(points) - 1)
    if count < 1:
        return 0.0
    near = nearest_neighbours(cKDTree(points), points[evenly_chosen(len(points), SAMPLE)], count + 1)[0][:, -1]
    return float(np.median(near) * np.sqrt(np.pi / count))


def plane_axes(outward: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "2 3"]:
    """Two unit vectors along the plane of a normal."""
    return np.asarray(np.linalg.svd(outward[None])[2][1:])


class Grid(NamedTuple):
    """Cells of the plane across a normal.

    Attributes:
        axes: two unit vectors along the cells, and the normal.
        lower: corner of the first cell.
        edge: of each cell.
        shape: number of rows and of columns.
    """

    axes: Float64[np.ndarray, "3 3"]
    lower: Float64[np.ndarray, " 2"]
    edge: float
    shape: tuple[int, int]

    @classmethod
    def about(
        cls,
        sample: Float64[np.ndarray, "s 3"],
        outward: Float64[np.ndarray, " 3"],
        spacing: float,
        points: Float64[np.ndarray, "n 3"],
        reach: float,
    ) -> "Grid":
        """Cells that reach over points and about them, turned by half a radian from the longest extent of a sample.

        So a straight edge lies along no row of cells, and the cells turn with the change.

        Args:
            sample: points of the change.
            outward: unit normal.
            spacing: of the points of the change.
            points: that are in cells.
            reach: how far the cells reach beyond them.
        """
        across = plane_axes(outward)
        plan = (sample - sample.mean(axis=0)) @ across.T
        # The senses are those of the longer tails, so that neither the frame nor the side of the normal matters.
        axes = np.linalg.eigh(plan.T @ plan)[1].T[::-1]
        axes *= np.where(((plan @ axes.T) ** 3).sum(axis=0) < 0, -1.0, 1.0)[:, None]
        turn = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
        axes = np.concatenate([turn @ axes @ across, outward[None]])
        plan = points @ axes[:2].T
        size = np.ptp(plan, axis=0) + 2 * reach
        edge = max(CELL * spacing, float(np.sqrt(size.prod() / MAX_CELLS)))
        rows, columns = np.ceil(size / edge).astype(int).tolist()
        return cls(axes, plan.min(axis=0) - reach, edge, (rows, columns))

    def heights(self, points: Float64[np.ndarray, "n 3"]) -> "Heights":
        """The heights of the points of each cell."""
        places = points @ self.axes.T
        indices = np.floor((places[:, :2] - self.lower) / self.edge).astype(int)
        inside = ((indices >= 0) & (indices < self.shape)).all(axis=1)
        cells, values = indices[inside] @ [self.shape[1], 1], places[inside, 2]
        count = np.bincount(cells, minlength=self.shape[0] * self.shape[1])
        with np.errstate(invalid="ignore"):
            mean, square = (np.bincount(cells, own, count.size) / count for own in (values, values**2))
        spread = np.sqrt(np.maximum(square - mean**2, 0))
        return Heights(*(own.reshape(self.shape) for own in (count, mean, np.nan_to_num(spread))))


class Heights(NamedTuple):
    """The points in each cell along the normal.

    Attributes:
        points: how many there are.
        mean: of their heights; NaN where there are none.
        spread: their standard deviation; 0 where there are none.
    """

    points: Int[np.ndarray, "r c"]
    mean: Float64[np.ndarray, "r c"]
    spread: Float64[np.ndarray, "r c"]


class SurfaceVolume(NamedTuple):
    """A volume between two surfaces.

    Attributes:
        gain: what the after surface lies above the before surface; negative where it was lost.
        error: half-width of its 95 % interval.
        registration_error: the part of it, likewise, that is common to all cells.
    """

    gain: float
    error: float
    registration_error: float


class DifferenceCells(NamedTuple):
    """The differences between both scans in the cells of a change.

    Attributes:
        edge: of a cell.
        changed: the cells of its points, with the gaps between them closed.
        beside: those that its thin edge may be in: both scans have one surface there, and no other change.
        difference: by how much the after scan is above the before scan; NaN where one of them shows nothing.
        measured: the cells in which both have points of a surface.
        sides: the cells that an upright side of the change runs through, the half of which is of the change.
        upright: fraction of the cells with its points that are such.
        behind: fraction of the cells in which its own scan shows the other scan's surface behind it.
    """

    edge: float
    changed: Bool[np.ndarray, "r c"]
    beside: Bool[np.ndarray, "r c"]
    difference: Float64[np.ndarray, "r c"]
    measured: Bool[np.ndarray, "r c"]
    sides: Bool[np.ndarray, "r c"]
    upright: float
    behind: float

    @classmethod
    def of(
        cls,
        grid: Grid,
        points: Pair[Float64[np.ndarray, "_ 3"]],
        clouds: Pair[Float64[np.ndarray, "_ 3"]],
        others: Float64[np.ndarray, "m 3"],
        background: Float64[np.ndarray, "b 3"],
        *,
        after: bool,
        directed: bool = True,
    ) -> "DifferenceCells | None":
        """The cells of a change; None where there are none that are not of other changes.

        Args:
            grid: the cells.
            points: of the change in either scan.
            clouds: all points of both scans about it, at its level.
            others: the points of other changes among these.
            background: the points of no change in the scan that the change is in.
            after: whether that is the after scan.
            directed: whether the normal is known to point to the outer side: of a pit its scan shows nothing behind it.
        """
        own, every = points.map(grid.heights), clouds.map(grid.heights)
        count = own.before.points + own.after.points
        # A cell on the border of two changes is of the one that has more points there.
        foreign = grid.heights(others).points > count
        changed = ndimage.binary_fill_holes(ndimage.binary_closing((count > 0) & ~foreign, SQUARE)) & ~foreign
        if not changed.any():
            return None
        steep = each(lambda of: of.spread > grid.edge, own)
        heights = each(
            lambda of, all, up: np.where(up, np.nan, np.where(of.points > 0, of.mean, all.mean)), own, every, steep
        )
        # The sparser scan has points in some of the cells only.
        passes = 1 + int(min(np.ceil(_sparsest(points, clouds) * CELL / grid.edge), 8))
        surfaces = heights.map(lambda of: _filled(_filled(of, changed, passes), ~changed, passes - 1))
        sides = (steep.before | steep.after) & changed
        difference = (surfaces.after - surfaces.before) * np.where(sides, 0.5, 1.0)
        rough = (every.before.spread > grid.edge) | (every.after.spread > grid.edge)
        mine, other = (own.after, surfaces.before) if after else (own.before, surfaces.after)
        shown = _filled(grid.heights(background).mean, changed, 1)
        rise = mine.mean - other if directed else np.abs(mine.mean - other)
        behind = (np.abs(shown - other) < np.abs(shown - mine.mean)) & (rise > grid.edge)
        inner = ndimage.binary_erosion(changed, SQUARE)
        return cls(
            grid.edge,
            changed,
            ~changed & ~foreign & ~rough & np.isfinite(difference),
            difference,
            np.isfinite(heights.after - heights.before),
            sides,
            upright=float(sides[changed & (count > 0)].mean()),
            behind=float(behind[inner].mean()) if inner.any() else 0.0,
        )

    @property
    def closed(self) -> bool:
        """True where the change is an object off the other scan's surface, or its distance to that is known nowhere."""
        known = np.isfinite(self.difference[self.changed]).mean()
        return bool(self.behind > 0.5 or self.upright > 0.5 or known < 0.5)

    @property
    def area(self) -> float:
        """Area of the changed cells."""
        return float(self.changed.sum() * self.edge**2)

    def volumes(self, registration_error: float, *, whole: bool) -> list[SurfaceVolume]:
        """The volume, or both of a change of which a part was surely gained and the rest lost, the larger one first.

        Args:
            registration_error: of the pair, standard deviation.
            whole: whether it is one object, of which no part is gained where another one is lost.
        """
        single = self._volume(registration_error)
        smooth = ndimage.median_filter(np.nan_to_num(self.difference), 3)
        against = ndimage.binary_opening(self.changed & (np.sign(single.gain) * smooth < 0), SQUARE)
        if whole or not against.any():
            return [single]
        nearest = ndimage.distance_transform_edt(~self.changed, return_distances=False, return_indices=True)
        opposite = against[tuple(nearest)]
        parts = [
            self._replace(changed=self.changed & own, beside=self.beside & own)._volume(registration_error)
            for own in (opposite, ~opposite)
        ]
        if parts[0].gain * parts[1].gain >= 0 or any(abs(part.gain) <= part.error for part in parts):
            return [single]
        return sorted(parts, key=lambda part: -abs(part.gain))

    def _volume(self, registration_error: float) -> SurfaceVolume:
        if not np.isfinite(self.difference[self.changed]).any():
            return SurfaceVolume(0.0, np.inf, 0.0)
        rim = self._thin_edge(registration_error)
        cells = self.changed | rim
        # Cells of the change in which a scan shows nothing are as thick as the others.
        total = np.nanmean(self.difference[self.changed]) * self.changed.sum() + self.difference[rim].sum()
        known = np.where(self.measured, self.difference, np.nan)
        mean, number = _mean_of_neighbours(known)
        deviations = (known - mean)[ndimage.binary_dilation(cells, SQUARE)]
        number = number[ndimage.binary_dilation(cells, SQUARE)]
        noise = np.sqrt(np.nansum(deviations**2 * number / (number + 1)))
        noise *= cells.sum() / max((cells & self.measured).sum(), 1)
        # The outline is anywhere in its cells, uniformly, and common to the cells of each of four sides.
        outline = self.changed & ~ndimage.binary_erosion(self.changed, SQUARE)
        thickness = np.abs(np.nan_to_num(self.difference)) * np.where(self.sides, 2, 1)
        noise = np.hypot(noise, thickness[outline].sum() / (2 * np.sqrt(12)))
        common = cells.sum() * registration_error
        scaled = (total, QUANTILE * np.hypot(noise, common), QUANTILE * common)
        return SurfaceVolume(*(float(self.edge**2 * own) for own in scaled))

    def _thin_edge(self, registration_error: float) -> Bool[np.ndarray, "r c"]:
        """The cells about the change, ring by ring, while their mean difference can be told from none."""
        inside = self.difference[self.changed]
        sense, most = np.sign(np.nanmean(inside)), np.nanmax(np.abs(inside))
        distance = ndimage.distance_transform_edt(~self.changed)
        with np.errstate(invalid="ignore"):
            usable = self.beside & (np.abs(self.difference) <= most)
        # Upright sides have no thin edge.
        widest = 0 if self.upright > 0.1 else max(1, round(np.sqrt(self.changed.sum() / np.pi)))
        for ring in range(1, widest + 1):
            values = sense * self.difference[usable & (distance > ring - 1) & (distance <= ring)]
            error = (
                np.hypot(values.std(ddof=1) / np.sqrt(len(values)), registration_error) if len(values) > 1 else np.inf
            )
            if len(values) < 2 or values.mean() <= error:
                return usable & (distance <= ring - 1)
        return usable & (distance <= widest)


def _sparsest(points: Pair[Float64[np.ndarray, "_ 3"]], clouds: Pair[Float64[np.ndarray, "_ 3"]]) -> float:
    """The spacing of the sparser scan within the bounds of a change."""
    change = np.concatenate([*points])
    lower, upper = change.min(axis=0), change.max(axis=0)
    lower, upper = lower - (upper - lower).max() / 2, upper + (upper - lower).max() / 2
    return max(spacing_of(cloud[within_box(cloud, lower, upper)]) for cloud in clouds)


def _filled(
    values: Float64[np.ndarray, "r c"], mask: Bool[np.ndarray, "r c"], passes: int
) -> Float64[np.ndarray, "r c"]:
    """Values, in the cells of a mask that have none by the mean of the neighbours in it that have one."""
    for _ in range(passes):
        mean, _number = _mean_of_neighbours(np.where(mask, values, np.nan))
        values = np.where(mask & np.isnan(values), mean, values)
    return values


def _mean_of_neighbours(
    values: Float64[np.ndarray, "r c"],
) -> tuple[Float64[np.ndarray, "r c"], Float64[np.ndarray, "r c"]]:
    """The mean of the eight values about each cell, NaN where there are none, and how many there are."""
    known = np.isfinite(values)
    number = ndimage.convolve(known.astype(float), RING, mode="constant")
    total = ndimage.convolve(np.where(known, values, 0.0), RING, mode="constant")
    with np.errstate(invalid="ignore"):
        return total / number, number
