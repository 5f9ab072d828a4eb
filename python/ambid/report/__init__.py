"""The story of a diagnosis as one self-contained file, HTML or PDF, for reading, printing and passing on."""

from ambid.report.report import check_suffix, write_report

__all__ = ["check_suffix", "write_report"]
