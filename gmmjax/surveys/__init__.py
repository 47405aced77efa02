"""Recordings of robots: frames of a depth sensor with their times and poses, bags, and the maps made of them."""

from gmmjax.surveys.bag_opening import load_rosbags as load_rosbags
from gmmjax.surveys.bag_writing import write_bag as write_bag
from gmmjax.surveys.bags import Bag as Bag
from gmmjax.surveys.bags import Topic as Topic
from gmmjax.surveys.bags import open_bag as open_bag
from gmmjax.surveys.bags import sensor_trajectory as sensor_trajectory
from gmmjax.surveys.depth_images import read_depth_frame as read_depth_frame
from gmmjax.surveys.depth_images import write_depth_image as write_depth_image
from gmmjax.surveys.frame import Frame as Frame
from gmmjax.surveys.intrinsics import Intrinsics as Intrinsics
from gmmjax.surveys.intrinsics_file import read_intrinsics as read_intrinsics
from gmmjax.surveys.intrinsics_file import write_intrinsics as write_intrinsics
from gmmjax.surveys.localised_map import LocalisedMap as LocalisedMap
from gmmjax.surveys.localised_map import localised_map as localised_map
from gmmjax.surveys.placed_frames import FrameMap as FrameMap
from gmmjax.surveys.placed_frames import PlacedFrames as PlacedFrames
from gmmjax.surveys.point_cloud2 import decode_cloud as decode_cloud
from gmmjax.surveys.trajectory import MAX_GAP as MAX_GAP
from gmmjax.surveys.trajectory import Trajectory as Trajectory
from gmmjax.surveys.trajectory import pose_matrix as pose_matrix
from gmmjax.surveys.transforms import TransformTree as TransformTree
from gmmjax.surveys.volumetric_map import VolumetricMap as VolumetricMap
from gmmjax.surveys.volumetric_map import volumetric_map as volumetric_map
