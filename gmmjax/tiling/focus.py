"""Where something looks changed: the only places whose full resolution has to be in memory.

The voxels around all that looks changed are taken from the blocks, and beyond them the coarse clouds that the scans
were registered in. So each candidate, and all that its facts look at, is as fine as the scans are.
"""

import dataclasses
import logging
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes import (
    CandidateSettings,
    LocalExaminationSettings,
    PointFigures,
    clusters_with_core,
    examined_spacing,
)
from gmmjax.clouds import Block, voxel_grid
from gmmjax.geometry import within_box, workers_for
from gmmjax.pair import Pair, each, each_on_cores
from gmmjax.tiling.compared_blocks import ComparedBlocks, ComparedVoxels
from gmmjax.tiling.local_differences import CoarseClouds
from gmmjax.tiling.local_voxels import Voxels, joined

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True)
class FocusSettings:
    """How much is taken at full resolution.

    Attributes:
        margin: beyond what facts look at, in spacings of the candidate: the neighbours that the planes of its outermost
            points go through.
        most_voxels: of either cloud, at most; with more, the smallest ones are doubled. A bound on memory: a million
            take about a gigabyte.
    """

    margin: float = 8.0
    most_voxels: int = 1_000_000


class FocusedCloud(NamedTuple):
    """One cloud, fine where something looks changed, coarse elsewhere.

    Attributes:
        voxels: first the fine ones.
        figures: the signed distance at each; at a coarse one that at the voxel next to it.
        blocks: the number of the block of each voxel of the blocks that is in a fine one, ascending.
        indices: its number in that block.
        rows: the fine voxel that it is in.
    """

    voxels: Voxels
    figures: PointFigures
    blocks: Int[np.ndarray, " b"]
    indices: Int[np.ndarray, " b"]
    rows: Int[np.ndarray, " b"]

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


def focused(
    blocks: ComparedBlocks,
    coarse: CoarseClouds,
    threshold: float,
    examination: LocalExaminationSettings,
    settings: FocusSettings = FocusSettings(),
) -> Pair[FocusedCloud]:
    """Both clouds, fine where either looks changed.

    Args:
        blocks: of both clouds, compared.
        coarse: the clouds elsewhere.
        threshold: probability from which on a voxel looks changed.
        examination: how far around a candidate its facts look.
        settings: how much is taken.
    """
    places = _places(_changed(blocks, threshold), threshold, blocks.candidates, examination, settings)
    parts = Pair([_Part.none()], [_Part.none()])
    around = coarse.points.map(_Around.of)
    for block, compared in blocks:
        met = any(one.touches(block) for one in places)
        for of_coarse, of_parts, own in zip(around, parts, compared, strict=True):
            of_coarse.take(block, own)
            if met:
                of_parts.append(_Part.of(block.number, places, own))
    least = blocks.voxels.least
    clouds = each(lambda *own: _focused_cloud(places, coarse.voxel_size, least, settings, *own), parts, around)
    logger.info(
        "fine voxels where something looks changed: %d and %d", *clouds.map(lambda own: own.rows.max(initial=-1) + 1)
    )
    return clouds


class _Changed(NamedTuple):
    """The voxels of a cloud that look changed."""

    points: Float64[np.ndarray, "n 3"]
    sizes: Float64[np.ndarray, " n"]
    probability: Float64[np.ndarray, " n"]


def _changed(blocks: ComparedBlocks, threshold: float) -> Pair[_Changed]:
    empty = _Changed(np.empty((0, 3)), np.empty(0), np.empty(0))
    parts = Pair([empty], [empty])
    for _, compared in blocks:
        for side, own in zip(parts, compared, strict=True):
            rows = np.flatnonzero(own.looks_changed >= threshold)
            side.append(_Changed(own.voxels.points[rows], own.voxels.sizes[rows], own.looks_changed[rows]))
    return parts.map(lambda own: _Changed(*(np.concatenate(values) for values in zip(*own, strict=True))))


class _Places(NamedTuple):
    """Places with one reach around them.

    Attributes:
        tree: of the places.
        reach: distance from them.
    """

    tree: cKDTree
    reach: float

    def touches(self, block: Block) -> bool:
        """Whether anything of a block may be within reach."""
        return bool(self.tree.query(block.centre)[0] <= self.reach + np.sqrt(3) / 2 * block.edge)

    def within(self, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which points are within reach."""
        found = self.tree.query(points, distance_upper_bound=self.reach, workers=workers_for(len(points)))
        return np.asarray(np.isfinite(found[0]))


def _places(
    changed: Pair[_Changed],
    threshold: float,
    candidates: CandidateSettings,
    examination: LocalExaminationSettings,
    settings: FocusSettings,
) -> list[_Places]:
    """A few places for all candidates of each spacing that candidates are examined at."""
    by_spacing: dict[float, list[np.ndarray]] = {}

    def labels(own: _Changed) -> Int[np.ndarray, " n"]:
        return clusters_with_core(own.points, own.probability, own.sizes, threshold, candidates.local)

    for own, label in zip(changed, each_on_cores(labels, changed), strict=True):
        order = np.argsort(label, kind="stable")
        numbers, starts = np.unique(label[order], return_index=True)
        for number, rows in zip(numbers, np.split(order, starts[1:]), strict=True):
            if number < 0:
                continue
            by_spacing.setdefault(examined_spacing(own.sizes[rows], examination), []).append(own.points[rows])
    return [
        _Places(cKDTree(voxel_grid(np.concatenate(points), examination.reach / 8 * spacing).points), reach)
        for spacing, points in sorted(by_spacing.items())
        for reach in ((examination.reach + settings.margin) * spacing,)
    ]


def _within_any(places: list[_Places], points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    found = np.zeros(len(points), bool)
    for own in places:
        left = np.flatnonzero(~found)
        found[left] = own.within(points[left])
    return found


class _Part(NamedTuple):
    """What is fine of a block."""

    voxels: Voxels
    figures: PointFigures
    blocks: Int[np.ndarray, " b"]
    indices: Int[np.ndarray, " b"]

    @classmethod
    def none(cls) -> "_Part":
        empty, figures, nothing = np.empty(0), np.empty(0, np.float32), np.empty(0, np.int64)
        return cls(Voxels(np.empty((0, 3)), empty, empty), PointFigures(figures, figures, figures), nothing, nothing)

    @classmethod
    def of(cls, number: int, places: list[_Places], own: ComparedVoxels) -> "_Part":
        indices = np.flatnonzero(_within_any(places, own.voxels.points))
        return cls(
            Voxels(*(values[indices] for values in own.voxels)),
            PointFigures(*(values[indices] for values in own.figures)),
            np.full(len(indices), number),
            indices,
        )


class _Around(NamedTuple):
    """The coarse points of a cloud, and the signed distance at the voxel next to each."""

    points: Float64[np.ndarray, "c 3"]
    figures: PointFigures

    @classmethod
    def of(cls, points: Float64[np.ndarray, "c 3"]) -> "_Around":
        return cls(points, PointFigures(*(np.full(len(points), np.float32(np.nan)) for _ in PointFigures._fields)))

    def take(self, block: Block, own: ComparedVoxels) -> None:
        """Sets the figures of the points in a block."""
        rows = within_box(self.points, block.lower, block.lower + block.edge)
        if len(rows) and len(own.voxels.points):
            nearest = cKDTree(own.voxels.points).query(self.points[rows])[1]
            for values, found in zip(self.figures, own.figures, strict=True):
                values[rows] = found[nearest]


def _focused_cloud(
    places: list[_Places],
    voxel_size: float,
    least: float,
    settings: FocusSettings,
    parts: list[_Part],
    coarse: _Around,
) -> FocusedCloud:
    fine = Voxels(*(np.concatenate(values) for values in zip(*(own.voxels for own in parts), strict=True)))
    figures = PointFigures(*(np.concatenate(values) for values in zip(*(own.figures for own in parts), strict=True)))
    blocks, indices = (np.concatenate([own[place] for own in parts]) for place in (2, 3))
    rows = np.arange(len(fine.mass))
    while len(fine.mass) > settings.most_voxels:
        least *= 2
        fine, member = joined(fine, least)
        rows = member[rows]
        # Of the voxels that are joined, the figures of one of them.
        first = np.unique(member, return_index=True)[1]
        figures = PointFigures(*(values[first] for values in figures))
    outside = ~_within_any(places, coarse.points)
    beyond = coarse.points[outside]
    around = Voxels(beyond, np.ones(len(beyond)), np.full(len(beyond), voxel_size))
    return FocusedCloud(
        Voxels(*(np.concatenate(values) for values in zip(fine, around, strict=True))),
        PointFigures(*(np.concatenate([own, far[outside]]) for own, far in zip(figures, coarse.figures, strict=True))),
        blocks,
        indices,
        rows,
    )
