"""Findings of a result by their codes, which are stable; their texts are not."""

from ambid.findings import Finding, WithFindings

__all__ = ["codes", "the"]


def codes(of: WithFindings) -> list[str]:
    """The codes of all findings of a result, in its order."""
    return [finding.code for finding in of.findings]


def the(of: WithFindings, code: str) -> Finding:
    """The one finding of a code."""
    (found,) = (finding for finding in of.findings if finding.code == code)
    return found
