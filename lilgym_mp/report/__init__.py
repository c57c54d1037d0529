"""Tables and figures of the paper, and more, from recorded episodes: one page, and each item as files.

`make_report(places, directory)` does it all; docs/report.md says what each item shows. No torch here.
"""

from lilgym_mp.report.gathering import ReportError
from lilgym_mp.report.making import make_report

__all__ = ["ReportError", "make_report"]
