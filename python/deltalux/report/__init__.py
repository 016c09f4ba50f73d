"""The report: every method against the exact product, in error, run time and bytes, as a folder to read.

`report` is the only function that a script needs.
"""

from .run import METHODS, check_report, report

__all__ = ["METHODS", "check_report", "report"]
