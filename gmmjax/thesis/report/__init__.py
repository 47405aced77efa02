"""The thesis's laboratory and chapter 4 for people: folders, pages and the terminal."""

from gmmjax.thesis.report.chapter_files import open_folder as open_folder
from gmmjax.thesis.report.chapter_files import write_results as write_results
from gmmjax.thesis.report.chapter_page import thesis_html as thesis_html
from gmmjax.thesis.report.console import print_thesis as print_thesis
from gmmjax.thesis.report.laboratory_files import check_lab_folder as check_lab_folder
from gmmjax.thesis.report.laboratory_files import write_lab as write_lab
from gmmjax.thesis.report.laboratory_page import lab_page as lab_page
