"""The thesis's laboratory, simulated: its runs, a robot's survey of them, and pairs of clouds with the truth."""

from gmmjax.thesis.laboratory.pairs import CLOUD_KINDS as CLOUD_KINDS
from gmmjax.thesis.laboratory.pairs import VOXEL_SIZE as VOXEL_SIZE
from gmmjax.thesis.laboratory.pairs import CloudKind as CloudKind
from gmmjax.thesis.laboratory.pairs import LabCloud as LabCloud
from gmmjax.thesis.laboratory.pairs import lab_cloud as lab_cloud
from gmmjax.thesis.laboratory.pairs import lab_frames as lab_frames
from gmmjax.thesis.laboratory.pairs import lab_pair as lab_pair
from gmmjax.thesis.laboratory.pairs import lab_sources as lab_sources
from gmmjax.thesis.laboratory.pairs import labelled as labelled
from gmmjax.thesis.laboratory.recording import Recording as Recording
from gmmjax.thesis.laboratory.recording import recorded_run as recorded_run
from gmmjax.thesis.laboratory.runs import THINGS as THINGS
from gmmjax.thesis.laboratory.runs import laboratory_of as laboratory_of
