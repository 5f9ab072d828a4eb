"""What a file is after a fault: the old one, a new one that is whole, or a broken one."""

import json
import struct
from pathlib import Path

OLD = b"what was there before\n" * 500
ENDS = {".html": b"</html>", ".svg": b"</svg>"}


def write_old(path):
    """Put the old file in its place."""
    Path(path).write_bytes(OLD)


def left_over():
    """Temporary files in this folder, which are taken away."""
    found = list(Path().glob("**/.ambid-*.tmp"))
    for path in found:
        path.unlink()
    return len(found)


def is_writing(paths):
    """Whether a temporary file is there, or one of these is no longer the old one."""
    return any(Path().glob("**/.ambid-*.tmp")) or any(Path(path).stat().st_size != len(OLD) for path in paths)


def state(path):
    """`old`, `new`, `none` or `broken`."""
    if not path.exists():
        return "none"
    content = path.read_bytes()
    if content == OLD:
        return "old"
    return "new" if is_whole(path.suffix, content) else "broken"


def is_whole(suffix, content):
    """Whether a file that the command writes is complete."""
    if suffix == ".json":
        try:
            json.loads(content)
        except ValueError:
            return False
        return True
    if suffix == ".png":
        return list(chunks(content))[-1:] == [b"IEND"]
    if suffix == ".csv":
        rows = content.split(b"\n")
        return rows[-1] == b"" and len({row.count(b",") for row in rows[:-1]}) == 1 and len(rows) == 2 + ROWS
    return content.rstrip().endswith(ENDS[suffix])


ROWS = 1008
"""Of the records that `simulate` makes in these tests."""


def chunks(content):
    """Names of the chunks of a PNG file that are complete."""
    place = 8
    while place + 12 <= len(content):
        (length,) = struct.unpack(">I", content[place : place + 4])
        if place + 12 + length > len(content):
            return
        yield content[place + 4 : place + 8]
        place += 12 + length
