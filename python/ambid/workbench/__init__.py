"""The workbench: a page on which a person compares, adds, fits and exports, and the session behind it."""

from ambid.workbench.exporting import as_model_file, as_python, as_report
from ambid.workbench.serving import require_server, serve
from ambid.workbench.session import Bench, Session
from ambid.workbench.views import held
from ambid.workbench.windows import Windows

__all__ = ["Bench", "Session", "Windows", "as_model_file", "as_python", "as_report", "held", "require_server", "serve"]
