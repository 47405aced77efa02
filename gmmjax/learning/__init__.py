"""Learning the verdict on changes from simulated scenes of many kinds, and which changes are one moved object.

`gmmjax.learning.same_object` is a program of its own.
"""

from gmmjax.learning.candidate_rows import CHANGED as CHANGED
from gmmjax.learning.candidate_rows import NOT_CHANGED as NOT_CHANGED
from gmmjax.learning.candidate_rows import UNCHANGED as UNCHANGED
from gmmjax.learning.candidate_rows import UNOBSERVED as UNOBSERVED
from gmmjax.learning.candidate_rows import CandidateRows as CandidateRows
from gmmjax.learning.candidate_rows import PointTruth as PointTruth
from gmmjax.learning.candidate_rows import rows_of as rows_of
from gmmjax.learning.candidate_rows import rows_of_scans as rows_of_scans
from gmmjax.learning.collection import LEARNED_FROM as LEARNED_FROM
from gmmjax.learning.collection import Collected as Collected
from gmmjax.learning.collection import collected as collected
from gmmjax.learning.collection import read_rows as read_rows
from gmmjax.learning.collection import training_sources as training_sources
from gmmjax.learning.objective import bounds_of as bounds_of
from gmmjax.learning.objective import free_from as free_from
from gmmjax.learning.objective import log_likelihood as log_likelihood
from gmmjax.learning.objective import log_probabilities as log_probabilities
from gmmjax.learning.objective import signed as signed
from gmmjax.learning.training import PENALTIES as PENALTIES
from gmmjax.learning.training import LeftOut as LeftOut
from gmmjax.learning.training import learned as learned
from gmmjax.learning.training import left_out_table as left_out_table
