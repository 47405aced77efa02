"""Scenes with known changes: artificial Gaussians, a simulated room, the thesis's laboratory as a robot surveys it."""

from gmmjax.scenes.gaussians import OVERLAPS as OVERLAPS
from gmmjax.scenes.gaussians import GaussianScene as GaussianScene
from gmmjax.scenes.gaussians import Overlap as Overlap
from gmmjax.scenes.gaussians import fixed_scene as fixed_scene
from gmmjax.scenes.gaussians import random_scene as random_scene
from gmmjax.scenes.gaussians import replaced_scene as replaced_scene
from gmmjax.scenes.lab_clouds import LabCloud as LabCloud
from gmmjax.scenes.lab_clouds import LabPair as LabPair
from gmmjax.scenes.lab_clouds import lab_pair as lab_pair
from gmmjax.scenes.laboratory import LaboratoryScene as LaboratoryScene
from gmmjax.scenes.laboratory import laboratory_scene as laboratory_scene
from gmmjax.scenes.robot_survey import Recording as Recording
from gmmjax.scenes.robot_survey import recorded_run as recorded_run
