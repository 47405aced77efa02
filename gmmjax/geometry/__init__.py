"""Geometry of points and scanned surfaces: rigid transforms, ICP, local planes, clusters, depth images."""

from gmmjax.geometry.density_clusters import density_clusters as density_clusters
from gmmjax.geometry.depth_image import DepthImage as DepthImage
from gmmjax.geometry.depth_image import DepthImageSettings as DepthImageSettings
from gmmjax.geometry.depth_image import Frustum as Frustum
from gmmjax.geometry.depth_image import frustums as frustums
from gmmjax.geometry.icp import IcpSettings as IcpSettings
from gmmjax.geometry.icp import determined_part as determined_part
from gmmjax.geometry.icp import geman_mcclure as geman_mcclure
from gmmjax.geometry.icp import offset_derivatives as offset_derivatives
from gmmjax.geometry.icp import point_to_plane_icp as point_to_plane_icp
from gmmjax.geometry.local_surface import MEAN_NEIGHBOURS as MEAN_NEIGHBOURS
from gmmjax.geometry.local_surface import PLANE_NEIGHBOURS as PLANE_NEIGHBOURS
from gmmjax.geometry.local_surface import LocalSurface as LocalSurface
from gmmjax.geometry.local_surface import evenly_chosen as evenly_chosen
from gmmjax.geometry.local_surface import local_planes as local_planes
from gmmjax.geometry.neighbours import nearest_neighbours as nearest_neighbours
from gmmjax.geometry.planes import Plane as Plane
from gmmjax.geometry.planes import PlaneSettings as PlaneSettings
from gmmjax.geometry.planes import plane_surface as plane_surface
from gmmjax.geometry.planes import planes_of as planes_of
from gmmjax.geometry.rigid import least_squares_transform as least_squares_transform
from gmmjax.geometry.rigid import rigid_transform as rigid_transform
from gmmjax.geometry.rigid import rotated as rotated
from gmmjax.geometry.rigid import rotation_about as rotation_about
from gmmjax.geometry.rigid import transformed as transformed
from gmmjax.geometry.statistics import MEDIAN_TO_DEVIATION as MEDIAN_TO_DEVIATION
