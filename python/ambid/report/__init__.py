"""The story of a diagnosis as one self-contained HTML file, for reading, printing and passing on."""

from ambid.report.report import write_report

__all__ = ["write_report"]
