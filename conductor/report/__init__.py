"""The report of a campaign: a table for programs, one page for people.

``write_summary`` writes ``summary.parquet`` and ``summary.csv``; ``write_report`` writes those and
``report.html``; ``report_json`` gives the report's tables as plain data.
"""

from conductor.report.document import report_json, write_report
from conductor.report.summary import write_summary

__all__ = ["report_json", "write_report", "write_summary"]
