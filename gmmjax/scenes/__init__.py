"""Scenes with known changes: the thesis's artificial Gaussians."""

from gmmjax.scenes.gaussians import OVERLAPS as OVERLAPS
from gmmjax.scenes.gaussians import GaussianScene as GaussianScene
from gmmjax.scenes.gaussians import Overlap as Overlap
from gmmjax.scenes.gaussians import fixed_scene as fixed_scene
from gmmjax.scenes.gaussians import random_scene as random_scene
