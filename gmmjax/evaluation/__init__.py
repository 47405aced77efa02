"""Scores against truth, and the tables made of them."""

from gmmjax.evaluation.gaussians import CONDITIONS as CONDITIONS
from gmmjax.evaluation.gaussians import Condition as Condition
from gmmjax.evaluation.gaussians import Row as Row
from gmmjax.evaluation.gaussians import evaluate_gaussians as evaluate_gaussians
from gmmjax.evaluation.scores import Scores as Scores
from gmmjax.evaluation.scores import score_pair as score_pair
