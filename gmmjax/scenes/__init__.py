"""Scenes with known changes: artificial Gaussians, a simulated room; what such rooms are made of, and the camera."""

from gmmjax.scenes.depth_camera import DepthCamera as DepthCamera
from gmmjax.scenes.gaussians import OVERLAPS as OVERLAPS
from gmmjax.scenes.gaussians import GaussianScene as GaussianScene
from gmmjax.scenes.gaussians import Overlap as Overlap
from gmmjax.scenes.gaussians import fixed_scene as fixed_scene
from gmmjax.scenes.gaussians import random_scene as random_scene
from gmmjax.scenes.gaussians import replaced_scene as replaced_scene
from gmmjax.scenes.laboratory import Difficulty as Difficulty
from gmmjax.scenes.laboratory import LaboratoryScene as LaboratoryScene
from gmmjax.scenes.laboratory import SurveyKind as SurveyKind
from gmmjax.scenes.laboratory import laboratory_scene as laboratory_scene
from gmmjax.scenes.objects import ROOM_HALF_WIDTH as ROOM_HALF_WIDTH
from gmmjax.scenes.objects import StandingObject as StandingObject
from gmmjax.scenes.objects import on_floor as on_floor
from gmmjax.scenes.objects import standing_at as standing_at
from gmmjax.scenes.ray_casting import UNLABELLED as UNLABELLED
from gmmjax.scenes.ray_casting import Solid as Solid
from gmmjax.scenes.rearrangements import Gravity as Gravity
from gmmjax.scenes.rearrangements import InPlace as InPlace
from gmmjax.scenes.rearrangements import RearrangedScene as RearrangedScene
from gmmjax.scenes.rearrangements import RearrangementSettings as RearrangementSettings
from gmmjax.scenes.rearrangements import rearranged_scene as rearranged_scene
from gmmjax.scenes.rigid_motions import looking_at as looking_at
from gmmjax.scenes.rigid_motions import small_motion as small_motion
from gmmjax.scenes.visibility import seen as seen
from gmmjax.scenes.visibility import uncounted as uncounted
