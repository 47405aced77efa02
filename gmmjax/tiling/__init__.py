"""Scans of any size, out of core: their points on disk in blocks, and workers that compute each block."""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.batch import Workers as Workers
    from gmmjax.tiling.cloud_distances import DistanceSettings as DistanceSettings
    from gmmjax.tiling.cloud_distances import TiledDistances as TiledDistances
    from gmmjax.tiling.cloud_distances import block_distances as block_distances
    from gmmjax.tiling.cloud_distances import distances as distances
    from gmmjax.tiling.compute import columns_of as columns_of
    from gmmjax.tiling.compute import compute_blocks as compute_blocks
    from gmmjax.tiling.detection import TiledChanges as TiledChanges
    from gmmjax.tiling.detection import tiled_changes as tiled_changes
    from gmmjax.tiling.detection_settings import TiledDetectionSettings as TiledDetectionSettings
    from gmmjax.tiling.disk_store import DiskBlockStore as DiskBlockStore
    from gmmjax.tiling.disk_store import temporary_block_store as temporary_block_store
    from gmmjax.tiling.disk_store import write_block_store as write_block_store
    from gmmjax.tiling.records import BlockRecords as BlockRecords
    from gmmjax.tiling.records import BlockResult as BlockResult
    from gmmjax.tiling.row_columns import RowColumns as RowColumns
    from gmmjax.tiling.tiles import Tile as Tile
    from gmmjax.tiling.tiles import TileSettings as TileSettings
    from gmmjax.tiling.tiles import tiles_of as tiles_of
    from gmmjax.tiling.worker import BlockTask as BlockTask

__getattr__, __dir__ = lazy_names(__name__)
