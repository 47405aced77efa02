"""Plots with matplotlib (the extra `plot`), which is imported when one is drawn.

Every function draws into the axes that it is given, or into a new figure, and returns the axes. None calls `show`, and
none changes matplotlib's settings.
"""

from gmmjax.plotting.change_map import MapPlotSettings as MapPlotSettings
from gmmjax.plotting.change_map import map_figure as map_figure
from gmmjax.plotting.change_map import plot_map as plot_map
from gmmjax.plotting.changes import plot_changes as plot_changes
from gmmjax.plotting.changes import plot_distance as plot_distance
from gmmjax.plotting.changes import plot_overview as plot_overview
from gmmjax.plotting.cloud_image import CloudImageSettings as CloudImageSettings
from gmmjax.plotting.evaluation import plot_reliability as plot_reliability
from gmmjax.plotting.evaluation import plot_scores as plot_scores
from gmmjax.plotting.figure_files import check_figure_file as check_figure_file
from gmmjax.plotting.figure_files import fit_figure as fit_figure
from gmmjax.plotting.figure_files import overview_figure as overview_figure
from gmmjax.plotting.figure_files import write_figure as write_figure
from gmmjax.plotting.map_files import check_map_file as check_map_file
from gmmjax.plotting.map_files import write_map as write_map
from gmmjax.plotting.mixtures import plot_grid_search as plot_grid_search
from gmmjax.plotting.mixtures import plot_message_length as plot_message_length
from gmmjax.plotting.mixtures import plot_mixture as plot_mixture
from gmmjax.plotting.mixtures import plot_transport as plot_transport
from gmmjax.plotting.projection import DIRECTIONS as DIRECTIONS
from gmmjax.plotting.projection import Direction as Direction
from gmmjax.plotting.registration import RegistrationPlotSettings as RegistrationPlotSettings
from gmmjax.plotting.registration import plot_registration as plot_registration
