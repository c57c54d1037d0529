"""Tables and figures of the paper, and more, from recorded episodes: one page, and each item as files.

`make_report(places, directory)` does it all; docs/report.md says what each item shows. No torch here.
"""

from lilgym_mp.report.html_report import make_report
from lilgym_mp.report.report_data import ReportError

__all__ = ["ReportError", "make_report"]
