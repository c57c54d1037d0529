"""Evaluation reports: the paper's tables and figures, and more, from recorded episodes.

`make_report(paths, directory)` writes one HTML page and every item as files; docs/report.md describes the items.
Does not import torch.
"""

from lilgym_mp.contrib.report.html_report import make_report
from lilgym_mp.contrib.report.report_data import ReportError

__all__ = ["ReportError", "make_report"]
