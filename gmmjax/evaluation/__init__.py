"""Any detector on any labelled pairs: scores against truth, and the tables made of them."""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.evaluation.benchmark import Evaluation as Evaluation
    from gmmjax.evaluation.benchmark import Failure as Failure
    from gmmjax.evaluation.benchmark import Row as Row
    from gmmjax.evaluation.benchmark import evaluate as evaluate
    from gmmjax.evaluation.detector_names import NAMES as NAMES
    from gmmjax.evaluation.detector_names import Name as Name
    from gmmjax.evaluation.detectors import Detection as Detection
    from gmmjax.evaluation.detectors import Detector as Detector
    from gmmjax.evaluation.detectors import available as available
    from gmmjax.evaluation.detectors import detector as detector
    from gmmjax.evaluation.gaussians import GAUSSIAN_FAMILIES as GAUSSIAN_FAMILIES
    from gmmjax.evaluation.gaussians import Condition as Condition
    from gmmjax.evaluation.gaussians import gaussian_pair as gaussian_pair
    from gmmjax.evaluation.gaussians import gaussian_sources as gaussian_sources
    from gmmjax.evaluation.labelled_pair import LabelledCloud as LabelledCloud
    from gmmjax.evaluation.labelled_pair import LabelledPair as LabelledPair
    from gmmjax.evaluation.labelled_pair import PairSource as PairSource
    from gmmjax.evaluation.labelled_pair import cloud_file as cloud_file
    from gmmjax.evaluation.labelled_pair import find_pairs as find_pairs
    from gmmjax.evaluation.labelled_pair import pair_folders as pair_folders
    from gmmjax.evaluation.labelled_pair import pair_views as pair_views
    from gmmjax.evaluation.labelled_pair import read_pair as read_pair
    from gmmjax.evaluation.labelled_pair import views_file as views_file
    from gmmjax.evaluation.reliability import Reliability as Reliability
    from gmmjax.evaluation.reliability import ReliabilityRecord as ReliabilityRecord
    from gmmjax.evaluation.scores import Scores as Scores
    from gmmjax.evaluation.scores import false_segments as false_segments
    from gmmjax.evaluation.scores import score_labelled_pair as score_labelled_pair
    from gmmjax.evaluation.scores import score_pair as score_pair
    from gmmjax.evaluation.surveyed_pairs import CONDITIONS as CONDITIONS
    from gmmjax.evaluation.surveyed_pairs import family_pair as family_pair
    from gmmjax.evaluation.surveyed_pairs import family_sources as family_sources
    from gmmjax.evaluation.surveyed_pairs import laboratory_pair as laboratory_pair
    from gmmjax.evaluation.surveyed_pairs import laboratory_sources as laboratory_sources
    from gmmjax.evaluation.tables import cells as cells
    from gmmjax.evaluation.tables import sections as sections

__getattr__, __dir__ = lazy_names(__name__)
