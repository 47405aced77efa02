"""What changed between two 3D scans, and how sure are you?"""

from gmmjax.changes import Change as Change
from gmmjax.changes import Changes as Changes
from gmmjax.changes import DetectionConfig as DetectionConfig
from gmmjax.changes import detect_changes as detect_changes
from gmmjax.clouds import PointCloud as PointCloud
from gmmjax.clouds import SensorViews as SensorViews
from gmmjax.clouds import read_cloud as read_cloud
from gmmjax.clouds import read_views as read_views
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
