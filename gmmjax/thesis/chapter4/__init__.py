"""Chapter 4 of the thesis again: its figures and tables from the same kinds of data, beside its published numbers."""

from gmmjax.thesis.chapter4.chapter import PARTS as PARTS
from gmmjax.thesis.chapter4.chapter import PartName as PartName
from gmmjax.thesis.chapter4.chapter import PartResult as PartResult
from gmmjax.thesis.chapter4.chapter import ThesisResults as ThesisResults
from gmmjax.thesis.chapter4.chapter import run_chapter as run_chapter
from gmmjax.thesis.chapter4.journal import Journal as Journal
from gmmjax.thesis.chapter4.records import Outcome as Outcome
from gmmjax.thesis.chapter4.records import Plan as Plan
from gmmjax.thesis.chapter4.records import Table as Table
