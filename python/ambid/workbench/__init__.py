"""The workbench: a page on which a person compares, adds, fits and exports, and the session behind it."""

from ambid.workbench.exporting import as_model_file, as_python, as_report
from ambid.workbench.serving import require_server, serve
from ambid.workbench.session import Bench, Session

__all__ = ["Bench", "Session", "as_model_file", "as_python", "as_report", "require_server", "serve"]
