"""Files that nobody vouches for: what parsers raise becomes an error that names the file, and sizes are checked."""

from ambid.reading.guard import Provenance, reading, watched
from ambid.reading.matlab import load_mat, variables_of
from ambid.reading.sizes import MOST_COLUMNS, require_size

__all__ = ["MOST_COLUMNS", "Provenance", "load_mat", "reading", "require_size", "variables_of", "watched"]
