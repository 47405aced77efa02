"""Gradients through the fit: scores, checks, and priors and verdicts tuned by gradient."""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.comparison import joint_prior as joint_prior
    from gmmjax.tuning.folders import find_tuning_pairs as find_tuning_pairs
    from gmmjax.tuning.folders import scan_pair as scan_pair
    from gmmjax.tuning.gradient_check import GradientCheck as GradientCheck
    from gmmjax.tuning.gradient_check import check_gradient as check_gradient
    from gmmjax.tuning.pair_loss import DESCRIPTIONS as DESCRIPTIONS
    from gmmjax.tuning.pair_loss import LOSSES as LOSSES
    from gmmjax.tuning.parameter_names import PARAMETERS as PARAMETERS
    from gmmjax.tuning.parameter_names import TUNABLE as TUNABLE
    from gmmjax.tuning.scan_pairs import ScanPair as ScanPair
    from gmmjax.tuning.scan_pairs import unchanged_pair as unchanged_pair
    from gmmjax.tuning.scores import brier_score as brier_score
    from gmmjax.tuning.scores import expected_f1 as expected_f1
    from gmmjax.tuning.scores import held_out_log_likelihood as held_out_log_likelihood
    from gmmjax.tuning.scores import log_score as log_score
    from gmmjax.tuning.search import ALL as ALL
    from gmmjax.tuning.search import HELD_BACK as HELD_BACK
    from gmmjax.tuning.search import TRAINED as TRAINED
    from gmmjax.tuning.search import TuningState as TuningState
    from gmmjax.tuning.settings import TuningSettings as TuningSettings
    from gmmjax.tuning.tuner import STOPS as STOPS
    from gmmjax.tuning.tuner import TuningResult as TuningResult
    from gmmjax.tuning.tuner import tune as tune
    from gmmjax.tuning.tuner import tune_mixture as tune_mixture
    from gmmjax.tuning.verdict_tuning import VerdictCourse as VerdictCourse
    from gmmjax.tuning.verdict_tuning import VerdictResult as VerdictResult
    from gmmjax.tuning.verdict_tuning import VerdictState as VerdictState
    from gmmjax.tuning.verdict_tuning import tune_verdict as tune_verdict

__getattr__, __dir__ = lazy_names(__name__)
