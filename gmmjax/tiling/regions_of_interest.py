"""Regions of interest: where something looks changed, the only places whose full resolution has to be in memory.

The voxels around all that looks changed are taken from the blocks, and beyond them the coarse clouds that the scans
were registered in. So each candidate, and all that its facts look at, is as fine as the scans are.
"""

import functools
import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes import (
    NAMES,
    CandidateSettings,
    LocalExaminationSettings,
    clusters_with_core,
    examined_spacing,
)
from gmmjax.clouds import voxel_grid
from gmmjax.geometry import within_box, within_reach
from gmmjax.pair import Pair, parallel_map
from gmmjax.tiling.blocks import Block
from gmmjax.tiling.compared_blocks import ComparedBlocks, ComparedVoxels
from gmmjax.tiling.local_differences import CoarseClouds
from gmmjax.tiling.local_voxels import Voxels, joined

logger = logging.getLogger(__name__)


# Beyond what facts look at, in spacings of the candidate: the neighbours that the planes of its outermost points go
# through.
REACH_OF_PLANES = 8.0


class RefinedCloud(NamedTuple):
    """One cloud, fine where something looks changed, coarse elsewhere.

    Attributes:
        own: its voxels, first the fine ones. What was measured of a joined or coarse one is that of one of the voxels
            in it, or of the one next to it.
        blocks: the number of the block of each voxel of the blocks that is in a fine one, ascending.
        indices: its number in that block.
        rows: the fine voxel that it is in.
        coarse_blocks: the number of the block of each coarse voxel, ascending.
        coarse_indices: the number of the voxel in that block that is next to it.
    """

    own: ComparedVoxels
    blocks: Int[np.ndarray, " b"]
    indices: Int[np.ndarray, " b"]
    rows: Int[np.ndarray, " b"]
    coarse_blocks: Int[np.ndarray, " c"]
    coarse_indices: Int[np.ndarray, " c"]

    @property
    def fine(self) -> int:
        """The number of fine voxels."""
        return len(self.own.looks_changed) - len(self.coarse_blocks)

    def rows_of(self, number: int, count: int) -> Int[np.ndarray, " v"]:
        """The fine voxel that each voxel of a block is in, -1 for those that are in none.

        Args:
            number: of the block.
            count: of its voxels.
        """
        place = slice(*np.searchsorted(self.blocks, [number, number + 1]))
        rows = np.full(count, -1)
        rows[self.indices[place]] = self.rows[place]
        return rows

    def coarse_of(self, number: int) -> tuple[slice, Int[np.ndarray, " m"]]:
        """The coarse voxels in a block, by their place in the cloud, and the voxel of the block that is next to each.

        Args:
            number: of the block.
        """
        start, stop = map(int, np.searchsorted(self.coarse_blocks, [number, number + 1]))
        return slice(self.fine + start, self.fine + stop), self.coarse_indices[start:stop]


def refined_clouds(
    blocks: ComparedBlocks,
    coarse: CoarseClouds,
    threshold: float,
    examination: LocalExaminationSettings,
    max_voxels: int,
) -> Pair[RefinedCloud]:
    """Both clouds, fine where either looks changed.

    Args:
        blocks: of both clouds, compared.
        coarse: the clouds elsewhere.
        threshold: probability from which on a voxel looks changed.
        examination: how far around a candidate its facts look.
        max_voxels: fine ones of either cloud, at most; with more, the smallest ones are doubled.
    """
    changed = parallel_map(functools.partial(_changed, blocks, threshold), NAMES)
    places = _places(changed, threshold, blocks.candidates, examination)
    found = parallel_map(functools.partial(_found, blocks, places, threshold, max_voxels), NAMES, coarse.points)
    clouds = found.map(lambda own: _refined_cloud(places, coarse.voxel_size, *own))
    logger.info("fine voxels where something looks changed: %d and %d", *clouds.map(lambda own: own.fine))
    return clouds


class _Changed(NamedTuple):
    """The voxels of a cloud that look changed."""

    points: Float64[np.ndarray, "n 3"]
    sizes: Float64[np.ndarray, " n"]
    probability: Float64[np.ndarray, " n"]


def _changed(blocks: ComparedBlocks, threshold: float, side: str) -> _Changed:
    parts = [_Changed(np.empty((0, 3)), np.empty(0), np.empty(0))]
    for block in blocks.store.tree.blocks:
        own = blocks.side(block.number, side)
        rows = np.flatnonzero(own.looks_changed >= threshold)
        parts.append(_Changed(own.voxels.points[rows], own.voxels.sizes[rows], own.looks_changed[rows]))
    together: _Changed = _together(parts)
    return together


class _Places(NamedTuple):
    """Places with one reach around them.

    Attributes:
        tree: of the places.
        spacing: that the candidates there are examined at.
        reach: distance from them.
    """

    tree: cKDTree
    spacing: float
    reach: float

    def touches(self, block: Block) -> bool:
        """True where anything of a block may be within reach."""
        return bool(self.tree.query(block.centre)[0] <= self.reach + np.sqrt(3) / 2 * block.edge)

    def within(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Mask of the points within reach."""
        return within_reach(self.tree, points, self.reach)


def _places(
    changed: Pair[_Changed],
    threshold: float,
    candidates: CandidateSettings,
    examination: LocalExaminationSettings,
) -> list[_Places]:
    """A few places for all candidates of each spacing that candidates are examined at."""
    by_spacing: dict[float, list[np.ndarray]] = {}
    labels = parallel_map(
        lambda own: clusters_with_core(own.points, own.probability, own.sizes, threshold, candidates.local), changed
    )
    for own, label in zip(changed, labels, strict=True):
        order = np.argsort(label, kind="stable")
        order = order[label[order] >= 0]
        ends = np.flatnonzero(np.diff(label[order])) + 1
        for rows in np.split(order, ends) if len(order) else ():
            by_spacing.setdefault(examined_spacing(own.sizes[rows], examination), []).append(own.points[rows])
    return [
        _Places(
            cKDTree(voxel_grid(np.concatenate(points), examination.reach / 8 * spacing).points),
            spacing,
            (examination.reach + REACH_OF_PLANES) * spacing,
        )
        for spacing, points in sorted(by_spacing.items())
    ]


def _spacings(places: list[_Places], points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
    """The smallest spacing of the candidates within whose reach each point is; infinite out of reach."""
    found = np.full(len(points), np.inf)
    for own in places:
        left = np.flatnonzero(np.isinf(found))
        found[left[own.within(points[left])]] = own.spacing
    return found


class _Part(NamedTuple):
    """The fine voxels of a block.

    Attributes:
        own: its voxels within reach of candidates; those that do not look changed are joined to what the candidates are
            examined at.
        blocks: the number of the block, for each voxel of it that is in one of these.
        indices: of each in the block.
        rows: which of these it is in.
    """

    own: ComparedVoxels
    blocks: Int[np.ndarray, " n"]
    indices: Int[np.ndarray, " n"]
    rows: Int[np.ndarray, " n"]

    @classmethod
    def of(cls, number: int, places: list[_Places], own: ComparedVoxels, threshold: float) -> "_Part":
        spacings = _spacings(places, own.voxels.points)
        spacings[np.isfinite(spacings) & (own.looks_changed >= threshold)] = 0
        indices = np.flatnonzero(np.isfinite(spacings))
        fine, rows = _joined(_taken(own, indices), spacings[indices])
        return cls(fine, np.full(len(indices), number), indices, rows)

    @property
    def fine(self) -> int:
        """The number of fine voxels."""
        return len(self.own.looks_changed)

    def joined_to(self, least: float) -> "_Part":
        """Join the fine voxels to those of a size at least."""
        own, members = _joined(self.own, np.full(self.fine, least))
        return self._replace(own=own, rows=members[self.rows])


class _Around(NamedTuple):
    """The coarse points of a cloud in a block, with what was measured of the voxels next to them.

    Attributes:
        points: in the block.
        nearest: the voxel of the block next to each.
        blocks: the number of the block.
        indices: of that voxel in it.
    """

    points: Float64[np.ndarray, "c 3"]
    nearest: ComparedVoxels
    blocks: Int[np.ndarray, " c"]
    indices: Int[np.ndarray, " c"]

    @classmethod
    def of(cls, block: Block, points: Float64[np.ndarray, "n 3"], own: ComparedVoxels) -> "_Around":
        inside, indices = points[within_box(points, *block.grown(0.0))], np.empty(0, int)
        if len(own.voxels.points):
            indices = cKDTree(own.voxels.points).query(inside)[1]
        count = len(indices)
        return cls(inside[:count], _taken(own, indices), np.full(count, block.number), indices)


def _found(
    blocks: ComparedBlocks,
    places: list[_Places],
    threshold: float,
    max_voxels: int,
    side: str,
    coarse: Float64[np.ndarray, "c 3"],
) -> tuple[_Part, _Around]:
    """The fine voxels of one cloud, doubled until there are no more than `max_voxels`, and its coarse ones."""
    parts, around = list[_Part](), list[_Around]()
    least, count = blocks.voxels.finest, 0
    for block in blocks.store.tree.blocks:
        own, met = blocks.side(block.number, side), any(one.touches(block) for one in places)
        parts.append(_Part.of(block.number, places if met else [], own, threshold).joined_to(least))
        around.append(_Around.of(block, coarse, own))
        count += parts[-1].fine
        # At once, and not in the end: all of the voxels may be more than fit into memory.
        while count > max_voxels:
            least *= 2
            parts = [part.joined_to(least) for part in parts]
            count = sum(part.fine for part in parts)
    before = np.cumsum([0, *(part.fine for part in parts)])
    parts = [part._replace(rows=part.rows + first) for part, first in zip(parts, before[:-1], strict=True)]
    return _together(parts), _together(around)


def _taken(own: ComparedVoxels, rows: Int[np.ndarray, " m"]) -> ComparedVoxels:
    """Some of the voxels."""
    taken: ComparedVoxels = jax.tree.map(lambda values: values[rows], own)
    return taken


def _together(parts: Sequence[Any]) -> Any:
    """Records of arrays as one."""
    return jax.tree.map(lambda *values: np.concatenate(values), *parts)


def _refined_cloud(places: list[_Places], voxel_size: float, fine: _Part, coarse: _Around) -> RefinedCloud:
    beyond = np.flatnonzero(np.isinf(_spacings(places, coarse.points)))
    points, count = coarse.points[beyond], len(beyond)
    far = _taken(coarse.nearest, beyond)._replace(voxels=Voxels(points, np.ones(count), np.full(count, voxel_size)))
    beside = coarse.blocks[beyond], coarse.indices[beyond]
    return RefinedCloud(_together([fine.own, far]), fine.blocks, fine.indices, fine.rows, *beside)


def _joined(own: ComparedVoxels, least: Float64[np.ndarray, " n"]) -> tuple[ComparedVoxels, Int[np.ndarray, " n"]]:
    """Voxels joined to those of a size that is given for each, and for each the one that it is in."""
    parts, members, count = [], np.empty(len(least), np.int64), 0
    for size in np.unique(least):
        rows = np.flatnonzero(least == size)
        voxels, place = joined(Voxels(*(values[rows] for values in own.voxels)), float(size))
        members[rows] = count + place
        count += len(voxels.mass)
        # What was measured of the first of the voxels in each.
        first = rows[np.unique(place, return_index=True)[1]]
        parts.append(_taken(own, first)._replace(voxels=voxels))
    return (_together(parts) if parts else own), members
