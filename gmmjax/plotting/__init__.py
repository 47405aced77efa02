"""Plots with matplotlib, which is imported when one is drawn.

Every function draws into the axes that it is given, or into a new figure, and returns the axes. None calls `show`, and
none changes matplotlib's settings.
"""

from gmmjax.plotting.change_map import map_figure as map_figure
from gmmjax.plotting.change_map import plot_map as plot_map
from gmmjax.plotting.changes import plot_changes as plot_changes
from gmmjax.plotting.changes import plot_distance as plot_distance
from gmmjax.plotting.changes import plot_overview as plot_overview
from gmmjax.plotting.curves import plot_bars as plot_bars
from gmmjax.plotting.curves import plot_grid_search as plot_grid_search
from gmmjax.plotting.curves import plot_message_length as plot_message_length
from gmmjax.plotting.curves import plot_registration as plot_registration
from gmmjax.plotting.curves import plot_reliability as plot_reliability
from gmmjax.plotting.curves import plot_scores as plot_scores
from gmmjax.plotting.curves import reliability_figure as reliability_figure
from gmmjax.plotting.files import check_figure_file as check_figure_file
from gmmjax.plotting.files import check_map_file as check_map_file
from gmmjax.plotting.files import fit_figure as fit_figure
from gmmjax.plotting.files import overview_figure as overview_figure
from gmmjax.plotting.files import write_figure as write_figure
from gmmjax.plotting.files import write_map as write_map
from gmmjax.plotting.mixtures import plot_mixture as plot_mixture
from gmmjax.plotting.mixtures import plot_transport as plot_transport
from gmmjax.plotting.projection import DIRECTIONS as DIRECTIONS
from gmmjax.plotting.projection import Direction as Direction
from gmmjax.plotting.tuning import tuning_figure as tuning_figure
