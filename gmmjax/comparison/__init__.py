"""Two clouds compared by their mixtures: what changed, point by point, as functions that JAX can transform."""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.comparison.choices import Kinds as Kinds
    from gmmjax.comparison.choices import Method as Method
    from gmmjax.comparison.choices import Solver as Solver
    from gmmjax.comparison.cloud_comparison import FIT_SETTINGS as FIT_SETTINGS
    from gmmjax.comparison.cloud_comparison import compare as compare
    from gmmjax.comparison.greedy_removal import Removals as Removals
    from gmmjax.comparison.greedy_removal import remove_changed as remove_changed
    from gmmjax.comparison.joint_mixture import JointMixture as JointMixture
    from gmmjax.comparison.joint_mixture import component_posterior as component_posterior
    from gmmjax.comparison.joint_mixture import density_ratio as density_ratio
    from gmmjax.comparison.joint_mixture import log_joint as log_joint
    from gmmjax.comparison.joint_mixture import point_posterior as point_posterior
    from gmmjax.comparison.joint_mixture_model import NOISE_SHARE as NOISE_SHARE
    from gmmjax.comparison.joint_mixture_model import LabelledPoints as LabelledPoints
    from gmmjax.comparison.joint_mixture_model import fit_joint_mixture_from_seeds as fit_joint_mixture_from_seeds
    from gmmjax.comparison.joint_mixture_model import joint_prior as joint_prior
    from gmmjax.comparison.many_pairs import ComparedPair as ComparedPair
    from gmmjax.comparison.many_pairs import compare_many as compare_many
    from gmmjax.comparison.mixture_comparison import Decision as Decision
    from gmmjax.comparison.mixture_comparison import MixtureComparison as MixtureComparison
    from gmmjax.comparison.mixture_comparison import Strengths as Strengths
    from gmmjax.comparison.mixture_comparison import compare_mixtures as compare_mixtures
    from gmmjax.comparison.mixture_comparison import of_cloud as of_cloud
    from gmmjax.comparison.result import AveragedComparison as AveragedComparison
    from gmmjax.comparison.result import Comparison as Comparison
    from gmmjax.comparison.result import averaged as averaged
    from gmmjax.comparison.traced_comparison import joined as joined
    from gmmjax.comparison.unmatched_mass import Unmatched as Unmatched
    from gmmjax.comparison.unmatched_mass import unmatched_shares as unmatched_shares

__getattr__, __dir__ = lazy_names(__name__)
