"""Scans of any size, out of core: their points on disk in blocks, and workers that compute each block."""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.batch import Workers as Workers
    from gmmjax.tiling.block_store import BlockStore as BlockStore
    from gmmjax.tiling.block_store import write_block_store as write_block_store
    from gmmjax.tiling.blocks import Block as Block
    from gmmjax.tiling.blocks import BlockTree as BlockTree
    from gmmjax.tiling.blocks import tree_of as tree_of
    from gmmjax.tiling.compute import compute_blocks as compute_blocks
    from gmmjax.tiling.compute import tiles_of as tiles_of
    from gmmjax.tiling.detection import TiledChanges as TiledChanges
    from gmmjax.tiling.detection import tiled_changes as tiled_changes
    from gmmjax.tiling.detection_settings import TiledDetectionSettings as TiledDetectionSettings
    from gmmjax.tiling.placed_clouds import Lattice as Lattice
    from gmmjax.tiling.placed_clouds import PlacedClouds as PlacedClouds
    from gmmjax.tiling.records import BlockRecords as BlockRecords
    from gmmjax.tiling.row_columns import RowColumns as RowColumns

__getattr__, __dir__ = lazy_names(__name__)
