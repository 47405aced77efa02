"""Optimal transport between weighted components: exact, entropic and partial, in JAX."""

from gmmjax.transport.earth_movers import earth_movers_distance as earth_movers_distance
from gmmjax.transport.exact import exact_transport as exact_transport
from gmmjax.transport.ground_cost import GROUND_COSTS as GROUND_COSTS
from gmmjax.transport.ground_cost import GroundCost as GroundCost
from gmmjax.transport.ground_cost import bures_wasserstein as bures_wasserstein
from gmmjax.transport.ground_cost import bures_wasserstein_distance as bures_wasserstein_distance
from gmmjax.transport.ground_cost import distance_of_means as distance_of_means
from gmmjax.transport.ground_cost import euclidean as euclidean
from gmmjax.transport.partial import partial_transport as partial_transport
from gmmjax.transport.result import TransportResult as TransportResult
from gmmjax.transport.result import TransportStatus as TransportStatus
from gmmjax.transport.sinkhorn import default_epsilon as default_epsilon
from gmmjax.transport.sinkhorn import sinkhorn as sinkhorn
