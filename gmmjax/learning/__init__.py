"""Learning the verdict on changes from simulated scenes of many kinds, and which changes are one moved object.

`gmmjax.learning.same_object` is a program of its own.
"""

from gmmjax.learning.candidate_rows import CandidateRows as CandidateRows
from gmmjax.learning.candidate_rows import rows_of as rows_of
from gmmjax.learning.collection import LEARNED_FROM as LEARNED_FROM
from gmmjax.learning.collection import Collected as Collected
from gmmjax.learning.collection import collected as collected
from gmmjax.learning.collection import read_rows as read_rows
from gmmjax.learning.collection import write_rows as write_rows
from gmmjax.learning.training import LeftOut as LeftOut
from gmmjax.learning.training import TrainingSettings as TrainingSettings
from gmmjax.learning.training import learned as learned
