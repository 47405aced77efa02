"""The volume between the surfaces of two scans: of what was deposited on a surface, or eroded from it.

Both scans are gridded in the plane of the change, and their difference is summed over its cells, as a surveyor sums a
difference of elevation models; the plane may be inclined as a slope or upright as a wall. What both surveys disagree by
on the unchanged surface around the change is measured there and taken off.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy import ndimage, stats
from scipy.spatial import cKDTree

from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.changes.objects.difference_cells import (
    SQUARE,
    Hidden,
    between_sides,
    filled,
    hidden,
    noise,
    smoothed,
    steepness,
    with_sides,
)
from gmmjax.changes.objects.height_maps import HeightMapSettings, height_maps
from gmmjax.changes.objects.plane_grid import PlaneGrid
from gmmjax.changes.objects.surroundings_offset import Offset, OffsetSettings, surroundings_offset, without_spikes
from gmmjax.geometry import evenly_chosen, nearest_neighbours


@dataclasses.dataclass(frozen=True)
class SurfaceVolumeSettings:
    """How the volume between two surfaces is measured.

    All values are empirical: they come from development on the scenes of `tests/benchmarks/volumes`.

    Attributes:
        cell: edge of the cells, in point spacings of the sparser scan there. Smaller: cells without points; larger: the
            outline is coarse.
        neighbours: number of neighbours by which the spacing is measured. Fewer: that along the lines of a scanner.
        sample: number of points, at most, by which it is.
        heights: how those of each scan are measured in the cells.
        outline: standard deviation of where the steep sides of a change lie, in cells: of a cell there a scan may show
            one half only. 0: they are taken to be seen as evenly as flat ground.
        rim: what lies around the labelled points is of the change as long as its mean difference, ring by ring,
            exceeds this number of standard errors. Infinite: the thin rim, below the limit of detection, is left out.
        certain: cells beyond the labelled points, whose difference with their neighbours exceeds this number of
            standard errors, and the standard deviation of the heights within a cell, are of the change like those that
            are labelled; what a cell without points may hide counts where the line of sight to it does. 0: noise beside
            it is; infinite: what the detection has missed of it is left to the rim.
        reach: distance of such cells from the labelled ones, at most, in half extents of the change, and of what the
            rim of a pit hides, in its radii. 0: there are none; large: much is looked at that is not of the change.
        widest_rim: width of the rim, at most, in radii of the change, and of what its crest hides. 0: there is none.
        clear: distance from the change, in cells, from which on its surroundings begin. 0: its rim is in them.
        surroundings: width of the unchanged surroundings by which the change is measured, in its radii. 0: none, and
            the registration error is that of the pair.
        offset: how what both scans differ by there is measured.
        confidence: of the interval.
        most_cells: of the grid, at most: a bound on the memory.
    """

    cell: float = 2.5
    neighbours: int = 16
    sample: int = 1000
    heights: HeightMapSettings = HeightMapSettings()
    outline: float = 0.04
    rim: float = 1.0
    certain: float = 4.0
    reach: float = 2.0
    widest_rim: float = 0.6
    clear: float = 2.0
    surroundings: float = 0.8
    offset: OffsetSettings = OffsetSettings()
    confidence: float = 0.95
    most_cells: int = 1_000_000


class SurfaceVolume(NamedTuple):
    """The volume between two surfaces.

    Attributes:
        area: of the surface that is labelled.
        gain: what the after surface lies above the before surface; negative where it was lost.
        error: half-width of its interval.
        registration_error: the part of it, likewise, that is common to all points.
    """

    area: float
    gain: float
    error: float
    registration_error: float


def window_reach(
    points: Float64[np.ndarray, "n 3"], settings: SurfaceVolumeSettings = SurfaceVolumeSettings()
) -> float:
    """How far around the points of a change both scans are looked at: its rim and its surroundings.

    Args:
        points: of the change.
        settings: of their widths.
    """
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    spacing = _spacing(points, points, settings)
    return (settings.reach + settings.surroundings) / 2 * diagonal + 8 * settings.cell * spacing


class SurfaceMap(NamedTuple):
    """The difference between both scans about a change, in the cells of its plane.

    Attributes:
        change: with what both scans show there.
        grid: the cells.
        across: unit vectors along them.
        difference: by how much the after scan is above the before scan, without the offset; NaN where one of them has
            no points.
        shown: the cells where the scan with the higher surface has points; the others are in its shadow.
        partly: the cells where the scan with the lower surface has points in one part only, as beside the rim of a pit.
        rise: how far above the mean of a cell an upright side there ends; 0 in cells without one.
        offset: what both scans differ by in the surroundings.
        counts: of the points of the change.
        labelled: the cells with points of the change, gaps between them closed.
        core: these, and cells beyond them that are as certain.
        foreign: cells of other changes.
    """

    change: ChangeSurface
    grid: PlaneGrid
    across: Float64[np.ndarray, "2 3"]
    difference: Float64[np.ndarray, "r c"]
    shown: Bool[np.ndarray, "r c"]
    partly: Bool[np.ndarray, "r c"]
    rise: Float64[np.ndarray, "r c"]
    offset: Offset
    counts: Int[np.ndarray, "r c"]
    labelled: Bool[np.ndarray, "r c"]
    core: Bool[np.ndarray, "r c"]
    foreign: Bool[np.ndarray, "r c"]

    @classmethod
    def of(
        cls, change: ChangeSurface, registration_error: float, settings: SurfaceVolumeSettings = SurfaceVolumeSettings()
    ) -> "SurfaceMap | None":
        """The map of a change; None where the scans cannot be compared.

        Args:
            change: with what both scans show there.
            registration_error: of the pair, standard deviation; what is expected before the surroundings are looked at.
            settings: how it is made.
        """
        across = change.across()
        grid = _grid(change, across, settings)
        if grid is None:
            return None
        maps = height_maps(change, across, grid, settings.heights)
        difference = maps.after.heights - maps.before.heights
        # A cell on the border of two changes is of the one that has more points there.
        counts, others = (grid.counts(points @ across.T) for points in (change.points, change.others))
        foreign = others > counts
        core = ndimage.binary_fill_holes(ndimage.binary_closing((counts > 0) & ~foreign, SQUARE)) & ~foreign
        if not (core & np.isfinite(difference)).any():
            return None
        # Distance from the labelled cells, in cells. What is nearer to another change is of that one.
        distance = ndimage.distance_transform_edt(~core)
        if foreign.any():
            foreign = (ndimage.distance_transform_edt(~foreign) <= distance) & ~core
        beside = (distance > settings.clear) & ~foreign
        difference = without_spikes(difference, core, beside, settings.offset)
        offset = surroundings_offset(difference, beside, int(core.sum()), registration_error, settings.offset)
        higher = maps.after if np.nansum((difference - offset.value)[core]) >= 0 else maps.before
        shown = np.isfinite(higher.heights)
        partly = (maps.before if higher is maps.after else maps.after).partly
        spread = smoothed(np.fmax(maps.before.spread, maps.after.spread))
        grown = _grown(difference - offset.value, core, shown, spread, foreign, offset, settings)
        # Once more, in the surroundings of all of it.
        width = max(settings.clear, settings.surroundings * np.sqrt(grown.sum() / np.pi))
        distance = ndimage.distance_transform_edt(~grown) - _widest(grown, settings)
        around = (distance > settings.clear) & (distance <= settings.clear + width) & ~foreign
        offset = surroundings_offset(difference, around, int(grown.sum()), registration_error, settings.offset)
        difference = difference - offset.value
        rise = higher.rise(grid.edge, settings.heights.steepest)
        return cls(change, grid, across, difference, shown, partly, rise, offset, counts, core, grown, foreign)

    def volume(self, settings: SurfaceVolumeSettings = SurfaceVolumeSettings()) -> SurfaceVolume:
        """The volume between both surfaces over the change, its thin rim included.

        The uncertainty is made of the noise of the cells, which averages out; of the difference between both scans
        where nothing changed, which does not; of cells where one of the scans has no points, or on one side only; of
        the rim; and of what nobody saw between the sides of an object and behind it.

        Args:
            settings: how it is measured.
        """
        difference, offset = self.difference, self.offset
        footprint, left_out = _with_rim(difference, self.core, self.foreign, _widest(self.core, settings), settings)
        sense = float(np.sign(np.nansum(difference[footprint])))
        thickness = sense * difference
        crests, unseen = thickness + self.rise, ~self.shown & ~self.foreign
        between, inside = between_sides(crests, footprint & (self.rise > 0), unseen & ~footprint)
        thickness, of_sides = with_sides(thickness, crests, inside | (unseen & footprint))
        whole, gaps = filled(thickness, crests, footprint, self.shown)
        behind = self._hidden(thickness, footprint, inside, settings)
        outline = settings.outline * steepness(whole, footprint)
        of_cells = max(noise(difference, footprint), offset.density * footprint.sum())
        area, quantile = self.grid.edge**2, float(stats.t.ppf((1 + settings.confidence) / 2, offset.freedom))
        common = float(quantile * area * footprint.sum() * offset.error)
        of_rim = left_out**2 + outline**2 + of_sides**2 + self._of_partly(whole, footprint) ** 2
        independent = quantile * area * np.sqrt(of_cells + gaps + of_rim + between.error**2 + behind.error**2)
        return SurfaceVolume(
            area=float(area * (_labelled_share(self, settings) * self.labelled).sum()),
            gain=sense * float(area * (whole[footprint].sum() + between.volume + behind.volume)),
            error=float(np.hypot(common, independent)),
            registration_error=common,
        )

    def opposite(self, settings: SurfaceVolumeSettings = SurfaceVolumeSettings()) -> Bool[np.ndarray, "r c"]:
        """The cells of the change that were certainly gained where most of it was lost, or lost where it was gained.

        Single cells do not count, nor rows of them along a steep side.

        Args:
            settings: when a cell is certain.
        """
        sense = np.sign(np.nansum(self.difference[self.core]))
        smooth, error = _smooth_with_error(self.difference, self.offset)
        against = np.nan_to_num(-sense * smooth)
        certain = ndimage.binary_opening(self.labelled & (against > settings.certain * error), SQUARE)
        return np.asarray(ndimage.binary_propagation(certain, mask=self.labelled & (against > 0), structure=SQUARE))

    def _of_partly(self, whole: Float64[np.ndarray, "r c"], footprint: Bool[np.ndarray, "r c"]) -> float:
        """By how much the volume differs without the cells that show one part of the lower surface, in areas of a cell.

        Those beside gaps and at the outline are meant, where something may hide the rest; all of it where there are no
        others.
        """
        known = np.isfinite(self.difference)
        inside = ndimage.binary_erosion(footprint & known, SQUARE)
        fully = np.where(known & (inside | ~self.partly), whole, np.nan)
        if not np.isfinite(fully[footprint]).any():
            return float(whole[footprint].sum())
        return float((filled(fully, fully + self.rise, footprint, self.shown)[0] - whole)[footprint].sum())

    def _hidden(
        self,
        thickness: Float64[np.ndarray, "r c"],
        footprint: Bool[np.ndarray, "r c"],
        inside: Bool[np.ndarray, "r c"],
        settings: SurfaceVolumeSettings,
    ) -> Hidden:
        """What nobody saw behind the change, beyond what is between its sides; see `hidden`."""
        # The rim of a deep pit hides most of it; behind the crest of an object is its shadow, which is longer than it.
        reach = np.where(self.shown, settings.reach * np.sqrt(self.core.sum() / np.pi), _widest(self.core, settings))
        beside = (ndimage.distance_transform_edt(~footprint) <= reach) & ~self.foreign
        least = settings.certain * float(np.sqrt(self.offset.density))
        return hidden(thickness, self.shown, footprint, beside & ~inside, least)


def volumes_of(
    change: ChangeSurface,
    registration_error: float,
    settings: SurfaceVolumeSettings = SurfaceVolumeSettings(),
    *,
    whole: bool = False,
) -> tuple[SurfaceVolume, ...]:
    """The volume of a change, or both of one of which a part was gained and the rest lost, the larger one first.

    Args:
        change: with what both scans show there.
        registration_error: of the pair, standard deviation.
        settings: how they are measured.
        whole: whether it is one thing, of which no part is gained where another one is lost.

    Returns:
        Empty where the scans cannot be compared. Two where both are greater than the half-width of their interval.
    """
    found = SurfaceMap.of(change, registration_error, settings)
    if found is None:
        return ()
    single, cells = (found.volume(settings),), found.opposite(settings)
    if whole or not cells.any():
        return single
    maps = [SurfaceMap.of(part, registration_error, settings) for part in change.divided(found.grid, cells)]
    parts = [part.volume(settings) for part in maps if part is not None]
    if len(parts) < 2 or parts[0].gain * parts[1].gain >= 0 or any(abs(part.gain) <= part.error for part in parts):
        return single
    return tuple(sorted(parts, key=lambda part: -abs(part.gain)))


def _widest(core: Bool[np.ndarray, "r c"], settings: SurfaceVolumeSettings) -> int:
    """Width of the rim, at most, in cells."""
    return max(1, int(settings.widest_rim * np.sqrt(core.sum() / np.pi)))


def _grid(
    change: ChangeSurface, across: Float64[np.ndarray, "2 3"], settings: SurfaceVolumeSettings
) -> PlaneGrid | None:
    """Cells that reach over the change and its surroundings; None where it has no extent."""
    places = change.points @ across.T
    lower, upper = places.min(axis=0), places.max(axis=0)
    # Both scans' points are compared within the bounds of the change.
    spacings = [_spacing(places, places, settings)]
    for cloud in change.clouds:
        own = cloud @ across.T
        inside = ((own >= lower) & (own <= upper)).all(axis=1)
        spacings.append(_spacing(own, own[inside], settings))
    edge = settings.cell * max(spacings)
    extent = float((upper - lower).max())
    if not 0 < edge < np.inf or extent == 0:
        return None
    margin = (settings.reach + settings.surroundings) * extent / 2 + 6 * edge
    size = upper - lower + 2 * margin
    edge = max(edge, float(np.sqrt(size.prod() / settings.most_cells)))
    rows, columns = (int(np.ceil(length / edge)) for length in size)
    return PlaneGrid(lower - margin, edge, (rows, columns))


def _spacing(
    places: Float64[np.ndarray, "n d"], asked: Float64[np.ndarray, "m d"], settings: SurfaceVolumeSettings
) -> float:
    """The spacing of points on a surface, at some of them; 0 where there are too few."""
    if len(asked) < 2:
        return 0.0
    tree, count = cKDTree(places), min(settings.neighbours, len(places) - 1)
    chosen = asked[evenly_chosen(len(asked), settings.sample)]
    reach = nearest_neighbours(tree, chosen, count + 1)[0][:, -1]
    return float(np.median(reach) * np.sqrt(np.pi / count))


def _grown(
    difference: Float64[np.ndarray, "r c"],
    core: Bool[np.ndarray, "r c"],
    shown: Bool[np.ndarray, "r c"],
    spread: Float64[np.ndarray, "r c"],
    excluded: Bool[np.ndarray, "r c"],
    offset: Offset,
    settings: SurfaceVolumeSettings,
) -> Bool[np.ndarray, "r c"]:
    """The labelled cells with those beyond them whose difference is as certain, though no point is labelled there."""
    sense = np.sign(np.nansum(difference[core]))
    mean, error = _smooth_with_error(difference, offset)
    smooth = np.nan_to_num(sense * mean)
    certain = (smooth > settings.certain * error) & ~excluded
    # Where a scan has several levels, as in a rack, their mean depends on how much was seen of each.
    certain &= smooth > np.nan_to_num(spread)
    grown = ndimage.binary_propagation(core, mask=core | certain, structure=SQUARE)
    # Into the shadow of what rises no further than between cells that are seen; of a pit the shadow is a part.
    between = ndimage.binary_fill_holes(ndimage.binary_closing(grown & shown, SQUARE, _widest(core, settings)))
    return np.asarray(core | (grown & (shown | between)))


def _smooth_with_error(
    difference: Float64[np.ndarray, "r c"], offset: Offset
) -> tuple[Float64[np.ndarray, "r c"], Float64[np.ndarray, "r c"]]:
    """The mean difference of each cell and its neighbours, and its standard error; infinite where there are none."""
    number = ndimage.convolve(np.isfinite(difference).astype(float), SQUARE.astype(float), mode="constant")
    error = np.sqrt(np.divide(offset.density, number, out=np.full(number.shape, np.inf), where=number > 0))
    return smoothed(difference), np.hypot(error, offset.error)


def _with_rim(
    difference: Float64[np.ndarray, "r c"],
    core: Bool[np.ndarray, "r c"],
    foreign: Bool[np.ndarray, "r c"],
    widest: int,
    settings: SurfaceVolumeSettings,
) -> tuple[Bool[np.ndarray, "r c"], float]:
    """The cells of the change with its thin rim, and what the ring after it still holds, in cells.

    Args:
        difference: of each cell, without the offset.
        core: the cells that surely changed.
        foreign: cells of other changes.
        widest: width of the rim, at most, in cells.
        settings: where it ends.
    """
    sense = np.sign(np.nansum(difference[core]))
    distance = ndimage.distance_transform_edt(~core)
    reach, rest = 0, 0.0
    for ring in range(1, widest + 2):
        cells = (distance > ring - 1) & (distance <= ring) & ~foreign
        values = sense * difference[cells & np.isfinite(difference)]
        if len(values) < 2:
            break
        mean, error = float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
        rest = float(cells.sum()) * max(abs(mean), error)
        if mean <= settings.rim * error or ring > widest:
            break
        reach = ring
    return core | ((distance <= reach) & ~foreign), rest


def _labelled_share(found: SurfaceMap, settings: SurfaceVolumeSettings) -> Float64[np.ndarray, "r c"]:
    """How much of each cell is labelled: inside all of it, at the outline by the parts that have points."""
    whole = ndimage.binary_erosion(found.counts > 0, SQUARE)
    per_edge, (rows, columns) = settings.heights.parts, found.grid.shape
    parts = found.grid.cells(found.change.points @ found.across.T, per_edge)
    with_points = np.zeros(per_edge**2 * found.counts.size)
    with_points[parts[parts >= 0]] = 1
    share = with_points.reshape(rows, per_edge, columns, per_edge).mean(axis=(1, 3))
    return np.where(whole | (found.counts == 0), 1.0, share)
