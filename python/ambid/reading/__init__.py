"""Files that nobody vouches for: what parsers raise becomes an error that names the file, and sizes are checked."""

from ambid.reading.guard import MOST_COLUMNS, Provenance, reading, require_size, watched
from ambid.reading.matlab import load_mat, variables_of

__all__ = ["MOST_COLUMNS", "Provenance", "load_mat", "reading", "require_size", "variables_of", "watched"]
