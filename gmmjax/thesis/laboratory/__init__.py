"""The thesis's laboratory, simulated: its runs, a robot's survey of them, and the clouds and pairs with the truth."""

from gmmjax.thesis.laboratory.clouds import CLOUD_KINDS as CLOUD_KINDS
from gmmjax.thesis.laboratory.clouds import VOXEL_SIZE as VOXEL_SIZE
from gmmjax.thesis.laboratory.clouds import CloudKind as CloudKind
from gmmjax.thesis.laboratory.clouds import LabCloud as LabCloud
from gmmjax.thesis.laboratory.clouds import lab_cloud as lab_cloud
from gmmjax.thesis.laboratory.pairs import LabPair as LabPair
from gmmjax.thesis.laboratory.pairs import lab_frames as lab_frames
from gmmjax.thesis.laboratory.pairs import lab_pair as lab_pair
from gmmjax.thesis.laboratory.pairs import with_truth as with_truth
from gmmjax.thesis.laboratory.recording import FRAMES as FRAMES
from gmmjax.thesis.laboratory.recording import Pattern as Pattern
from gmmjax.thesis.laboratory.recording import Recording as Recording
from gmmjax.thesis.laboratory.recording import recorded_run as recorded_run
from gmmjax.thesis.laboratory.room import BAG as BAG
from gmmjax.thesis.laboratory.room import BOARD as BOARD
from gmmjax.thesis.laboratory.room import GEAR_BOX as GEAR_BOX
from gmmjax.thesis.laboratory.room import PANEL as PANEL
from gmmjax.thesis.laboratory.room import ROBOT as ROBOT
from gmmjax.thesis.laboratory.room import THINGS as THINGS
from gmmjax.thesis.laboratory.runs import PRESETS as PRESETS
from gmmjax.thesis.laboratory.runs import Laboratory as Laboratory
from gmmjax.thesis.laboratory.runs import Preset as Preset
from gmmjax.thesis.laboratory.runs import RunName as RunName
from gmmjax.thesis.laboratory.runs import laboratory_of as laboratory_of
