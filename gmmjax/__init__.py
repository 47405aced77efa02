"""What changed between two 3D scans, and how sure are you?"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gmmjax._compilation_cache import use_compilation_cache as use_compilation_cache
    from gmmjax.changes import Change as Change
    from gmmjax.changes import Changes as Changes
    from gmmjax.changes import Contribution as Contribution
    from gmmjax.changes import DetectionConfig as DetectionConfig
    from gmmjax.changes import Explanation as Explanation
    from gmmjax.changes import RejectedCandidate as RejectedCandidate
    from gmmjax.changes import detect_changes as detect_changes
    from gmmjax.clouds import PointCloud as PointCloud
    from gmmjax.clouds import SensorViews as SensorViews
    from gmmjax.clouds import read_cloud as read_cloud
    from gmmjax.clouds import read_survey as read_survey
    from gmmjax.clouds import read_views as read_views
    from gmmjax.comparison import AveragedComparison as AveragedComparison
    from gmmjax.comparison import Comparison as Comparison
    from gmmjax.comparison import averaged as averaged
    from gmmjax.comparison import compare as compare
    from gmmjax.comparison import compare_many as compare_many
    from gmmjax.errors import ComputationError as ComputationError
    from gmmjax.errors import InputError as InputError
    from gmmjax.errors import InputWarning as InputWarning
    from gmmjax.mixtures import Fit as Fit
    from gmmjax.mixtures import FitSettings as FitSettings
    from gmmjax.mixtures import FitStatus as FitStatus
    from gmmjax.mixtures import GaussianMixture as GaussianMixture
    from gmmjax.mixtures import Prior as Prior
    from gmmjax.mixtures import fit_mixture as fit_mixture
    from gmmjax.transport import TransportResult as TransportResult
    from gmmjax.transport import TransportStatus as TransportStatus
    from gmmjax.transport import earth_movers_distance as earth_movers_distance

__version__ = "0.1.0"

# The packages of the public names. They are imported when a name is first asked for, so that the command line is up,
# and can be interrupted cleanly, before JAX is imported.
_NAMES = {
    "_compilation_cache": ("use_compilation_cache",),
    "batch": (),
    "changes": (
        *("Change", "Changes", "Contribution", "DetectionConfig", "Explanation", "RejectedCandidate", "detect_changes"),
    ),
    "clouds": ("PointCloud", "SensorViews", "read_cloud", "read_survey", "read_views"),
    "comparison": ("AveragedComparison", "Comparison", "averaged", "compare", "compare_many"),
    "errors": ("ComputationError", "InputError", "InputWarning"),
    "mixtures": ("Fit", "FitSettings", "FitStatus", "GaussianMixture", "Prior", "fit_mixture"),
    "transport": ("TransportResult", "TransportStatus", "earth_movers_distance"),
}
_HOMES = {name: package for package, names in _NAMES.items() for name in names}

# Silent until the user configures logging.
logging.getLogger("gmmjax").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return import_module(f"gmmjax.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'gmmjax' has no attribute '{name}'")
    value = getattr(import_module(f"gmmjax.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, *_NAMES})
