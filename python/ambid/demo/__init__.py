"""The whole story on data that come with the package."""

from ambid.demo.story import DATA, FILES, run

__all__ = ["DATA", "FILES", "run"]
