"""Chapter 4 of the thesis: its figures and tables from data of the same kinds, beside its published numbers.

Each part of the chapter is a module with its units of work, its tables and its lines of the summary: `grid`,
`clustering`, `filtering`, `gaussians` and `surveys`.
"""

from typing import TYPE_CHECKING

from gmmjax._lazy_names import lazy_names

if TYPE_CHECKING:
    from gmmjax.thesis.chapter4 import clustering as clustering
    from gmmjax.thesis.chapter4 import filtering as filtering
    from gmmjax.thesis.chapter4 import gaussians as gaussians
    from gmmjax.thesis.chapter4 import grid as grid
    from gmmjax.thesis.chapter4 import surveys as surveys
    from gmmjax.thesis.chapter4.chapter import PartResult as PartResult
    from gmmjax.thesis.chapter4.chapter import ThesisResults as ThesisResults
    from gmmjax.thesis.chapter4.chapter import run_chapter as run_chapter
    from gmmjax.thesis.chapter4.journal import Journal as Journal
    from gmmjax.thesis.chapter4.measures import MEASURES as MEASURES
    from gmmjax.thesis.chapter4.measures import PUBLISHED as PUBLISHED
    from gmmjax.thesis.chapter4.measures import THESIS as THESIS
    from gmmjax.thesis.chapter4.part_names import PARTS as PARTS
    from gmmjax.thesis.chapter4.part_names import PartName as PartName
    from gmmjax.thesis.chapter4.records import Cell as Cell
    from gmmjax.thesis.chapter4.records import Headline as Headline
    from gmmjax.thesis.chapter4.records import Outcome as Outcome
    from gmmjax.thesis.chapter4.records import Plan as Plan
    from gmmjax.thesis.chapter4.records import Table as Table

__getattr__, __dir__ = lazy_names(__name__)
