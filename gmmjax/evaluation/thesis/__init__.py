"""Chapter 4 of the thesis again: its figures and tables from the same kinds of data, beside its published numbers."""

from gmmjax.evaluation.thesis.chapter import PARTS as PARTS
from gmmjax.evaluation.thesis.chapter import PartName as PartName
from gmmjax.evaluation.thesis.chapter import PartResult as PartResult
from gmmjax.evaluation.thesis.chapter import ThesisResults as ThesisResults
from gmmjax.evaluation.thesis.chapter import run_chapter as run_chapter
from gmmjax.evaluation.thesis.journal import Journal as Journal
from gmmjax.evaluation.thesis.records import Outcome as Outcome
from gmmjax.evaluation.thesis.records import Plan as Plan
from gmmjax.evaluation.thesis.records import Table as Table
