"""Evaluation reports: the paper's tables and figures, and more, from recorded episodes.

`make_report(paths, directory)` writes one HTML page and every item as files; docs/report.md describes the items.
Does not import torch.
"""

from lilgym_mp.contrib.report.report_data import ReportError
from lilgym_mp.contrib.report.writing import make_report
from lilgym_mp.submodules import submodule_getter

__all__ = ["ReportError", "make_report"]

__getattr__ = submodule_getter(__name__)
