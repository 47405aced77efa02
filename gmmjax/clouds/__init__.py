"""Point clouds on the host: records, readers, a writer, filters and voxels."""

from gmmjax.clouds.atomic import atomic_write as atomic_write
from gmmjax.clouds.files import parse_json as parse_json
from gmmjax.clouds.files import read_bytes as read_bytes
from gmmjax.clouds.files import read_json as read_json
from gmmjax.clouds.filters import crop_box as crop_box
from gmmjax.clouds.filters import statistical_outliers as statistical_outliers
from gmmjax.clouds.mesh import load_open3d as load_open3d
from gmmjax.clouds.pcd_writing import viewpoint_of as viewpoint_of
from gmmjax.clouds.pcd_writing import write_pcd as write_pcd
from gmmjax.clouds.ply import write_ply as write_ply
from gmmjax.clouds.point_cloud import PointCloud as PointCloud
from gmmjax.clouds.reading import read_cloud as read_cloud
from gmmjax.clouds.views import SensorViews as SensorViews
from gmmjax.clouds.views_file import read_views as read_views
from gmmjax.clouds.views_file import write_views as write_views
from gmmjax.clouds.voxel_grid import VoxelGrid as VoxelGrid
from gmmjax.clouds.voxel_grid import voxel_grid as voxel_grid
from gmmjax.clouds.voxel_grid import voxel_size_for as voxel_size_for
