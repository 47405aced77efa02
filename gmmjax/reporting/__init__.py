"""Results for people and programs: result folders, HTML report, terminal, mixtures and scenes on disk."""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.reporting.batch_files import save_report as save_report
    from gmmjax.reporting.batch_files import save_transformed_report as save_transformed_report
    from gmmjax.reporting.batch_files import write_history as write_history
    from gmmjax.reporting.batch_files import write_summary as write_summary
    from gmmjax.reporting.batch_index import batch_index_html as batch_index_html
    from gmmjax.reporting.geotiff import write_geotiff as write_geotiff
    from gmmjax.reporting.html_report import report_html as report_html
    from gmmjax.reporting.html_report import write_report as write_report
    from gmmjax.reporting.labelled_cloud import write_scan as write_scan
    from gmmjax.reporting.map_cells import ChangeMap as ChangeMap
    from gmmjax.reporting.map_cells import change_map as change_map
    from gmmjax.reporting.map_cells import check_upright as check_upright
    from gmmjax.reporting.mixture_files import read_mixture as read_mixture
    from gmmjax.reporting.mixture_files import write_mixture as write_mixture
    from gmmjax.reporting.notebook import notebook_html as notebook_html
    from gmmjax.reporting.page_parts import asset as asset
    from gmmjax.reporting.pictures import write_thumbnails as write_thumbnails
    from gmmjax.reporting.result_folder import check_result_folder as check_result_folder
    from gmmjax.reporting.result_folder import write_result as write_result
    from gmmjax.reporting.scene_files import write_scene as write_scene
    from gmmjax.reporting.scene_files import write_surveyed_scene as write_surveyed_scene
    from gmmjax.reporting.timeline_page import timeline_html as timeline_html

__getattr__, __dir__ = lazy_names(__name__)
