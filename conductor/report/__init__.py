"""The report of a campaign: a table for programs, one page for people.

``write_summary`` writes ``summary.parquet`` and ``summary.csv``; ``make_report`` writes those,
``report.html`` and plots, and :class:`conductor.run.report_preload.ReportPreload` does part of that
while the campaign runs; ``write_result_page`` writes a page to publish; ``report_json`` gives the
tables of the report as plain data.
"""

from conductor.report.pages.document import make_report, report_json, tables_of
from conductor.report.pages.result_page import write_result_page
from conductor.report.pages.summary import write_summary

__all__ = [
    "make_report",
    "report_json",
    "tables_of",
    "write_result_page",
    "write_summary",
]
