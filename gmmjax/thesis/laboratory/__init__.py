"""The thesis's laboratory, simulated: its runs, a robot's survey of them, and the clouds and pairs with the truth."""

from gmmjax.thesis.laboratory.pairs import LabCloud as LabCloud
from gmmjax.thesis.laboratory.pairs import LabPair as LabPair
from gmmjax.thesis.laboratory.pairs import lab_pair as lab_pair
from gmmjax.thesis.laboratory.recording import Recording as Recording
from gmmjax.thesis.laboratory.recording import recorded_run as recorded_run
