"""Any detector on any labelled pairs: scores against truth, and the tables made of them."""

from gmmjax.evaluation.benchmark import Evaluation as Evaluation
from gmmjax.evaluation.benchmark import Failure as Failure
from gmmjax.evaluation.benchmark import Row as Row
from gmmjax.evaluation.benchmark import evaluate as evaluate
from gmmjax.evaluation.detectors import NAMES as NAMES
from gmmjax.evaluation.detectors import Detection as Detection
from gmmjax.evaluation.detectors import Detector as Detector
from gmmjax.evaluation.detectors import available as available
from gmmjax.evaluation.detectors import detector as detector
from gmmjax.evaluation.gaussians import FAMILIES as FAMILIES
from gmmjax.evaluation.gaussians import Condition as Condition
from gmmjax.evaluation.gaussians import gaussian_pair as gaussian_pair
from gmmjax.evaluation.gaussians import gaussian_sources as gaussian_sources
from gmmjax.evaluation.labelled_pair import LabelledCloud as LabelledCloud
from gmmjax.evaluation.labelled_pair import LabelledPair as LabelledPair
from gmmjax.evaluation.labelled_pair import PairSource as PairSource
from gmmjax.evaluation.labelled_pair import find_pairs as find_pairs
from gmmjax.evaluation.labelled_pair import read_pair as read_pair
from gmmjax.evaluation.scores import Scores as Scores
from gmmjax.evaluation.scores import false_segments as false_segments
from gmmjax.evaluation.scores import score_labelled_pair as score_labelled_pair
from gmmjax.evaluation.scores import score_pair as score_pair
