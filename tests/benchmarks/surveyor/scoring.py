"""The scores of detections in scenes of which some points cannot be judged."""

import numpy as np

from gmmjax.evaluation import Scores, score_pair
from gmmjax.pair import Pair, each
from tests.benchmarks.surveyor.solids import UNJUDGED
from tests.benchmarks.surveyor.surveys import SurveyedPair


def scores(pair: SurveyedPair, labels: Pair[np.ndarray]) -> Scores:
    """Segment and point counts, as `gmmjax.evaluation.Scores` has them, over the points that can be judged.

    Args:
        pair: with the truth.
        labels: per point -1 or the number of a detected change.
    """
    judged = pair.truth.map(lambda truth: truth != UNJUDGED)
    own = each(lambda label, rows: label[rows], labels, judged)
    truth = each(lambda label, rows: label[rows], pair.truth, judged)
    return score_pair(*own, *truth)
