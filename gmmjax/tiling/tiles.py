"""Tiles: the blocks that one worker takes at a time. They bound the memory of a worker, and change no result."""

import dataclasses
from typing import TypeAlias

import numpy as np

from gmmjax.clouds import BlockTree
from gmmjax.errors import InputError

Tile: TypeAlias = tuple[int, ...]
"""The numbers of some blocks, ascending."""


@dataclasses.dataclass(frozen=True)
class TileSettings:
    """How blocks are put together to tiles.

    Attributes:
        points: of both clouds in a tile, where no size is given. 0: each block is a tile, and messages to the workers
            take time; many: workers have nothing to do while others compute the last tiles; infinite: there is one.
        spacings: edge of a tile in point spacings, at least: below, every tile is margin. 0: any size is taken.
    """

    points: float = 2.5e5
    spacings: float = 10.0


def tiles_of(tree: BlockTree, tile_size: float | None = None, settings: TileSettings = TileSettings()) -> list[Tile]:
    """The tiles of two clouds, each block in one of them.

    Args:
        tree: the blocks.
        tile_size: edge of a tile, in the unit of the clouds: a tile has the blocks whose centres are in it. None:
            a tile has consecutive blocks.
        settings: of the tiles.

    Raises:
        InputError: a tile size that is not positive and finite, or below ten point spacings.
    """
    if tile_size is None:
        points = np.cumsum(tree.counts.before + tree.counts.after)
        owner = points // max(settings.points, 1.0)
        keys = owner[:, None]
    else:
        _check_tile_size(tile_size, tree, settings)
        keys = (tree.lowers + tree.edges[:, None] / 2) // tile_size
    _, first, tile = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(tile.ravel(), kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(tile.ravel()))[:-1])
    # In the order of the blocks, so that tiles that follow each other are mostly adjacent.
    return [tuple(parts[number].tolist()) for number in np.argsort(first)]


def _check_tile_size(tile_size: float, tree: BlockTree, settings: TileSettings) -> None:
    if not 0 < tile_size < np.inf:
        raise InputError(f"tile_size={tile_size} must be positive and finite, in the unit of the scans")
    least = settings.spacings * float(np.nanmax(list(tree.spacing)))
    if tile_size < least:
        raise InputError(
            f"tile_size={tile_size:g} is below {settings.spacings:g} point spacings of the sparser scan; give at least "
            f"{1.005 * least:.3g}, or leave it out"
        )
