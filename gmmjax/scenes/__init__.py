"""Scenes with known changes: artificial Gaussians, a simulated room; what such rooms are made of, and the camera."""

from gmmjax.scenes.gaussians import OVERLAPS as OVERLAPS
from gmmjax.scenes.gaussians import GaussianScene as GaussianScene
from gmmjax.scenes.gaussians import Overlap as Overlap
from gmmjax.scenes.gaussians import fixed_scene as fixed_scene
from gmmjax.scenes.gaussians import random_scene as random_scene
from gmmjax.scenes.gaussians import replaced_scene as replaced_scene
from gmmjax.scenes.laboratory import LaboratoryScene as LaboratoryScene
from gmmjax.scenes.laboratory import laboratory_scene as laboratory_scene
