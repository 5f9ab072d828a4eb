"""What a file is after a fault: the old one, a new one that is whole, or a broken one."""

import json
import struct
import tomllib
import zipfile
from io import BytesIO
from pathlib import Path

import scipy.io

OLD = b"what was there before\n" * 500
ENDS = {
    ".html": b"</html>",
    ".svg": b"</svg>",
    ".pdf": b"%%EOF",
    ".tex": b"\\end{table}",
    ".m": b"\nend",
    ".parquet": b"PAR1",
}
ROWS = {"v.csv": 1008, "played.csv": 2032, "frf.csv": 56}
"""Of the tables that the commands of these tests write, below their head."""


def grows(path):
    """Whether a file stands in a folder to which a command adds: before it there was none."""
    return Path(path).parent.suffix == ".parquet"


def write_old(path):
    """Put the old file in its place."""
    if grows(path):
        Path(path).unlink(missing_ok=True)
    else:
        Path(path).write_bytes(OLD)


def left_over():
    """Temporary files in this folder, which are taken away."""
    found = list(Path().glob("**/.ambid-*.tmp"))
    for path in found:
        path.unlink()
    return len(found)


def is_writing(paths):
    """Whether a temporary file is there, or one of these is no longer the old one."""
    return any(Path().glob("**/.ambid-*.tmp")) or any(map(_is_touched, paths))


def _is_touched(path):
    if grows(path):
        return Path(path).exists()
    return Path(path).stat().st_size != len(OLD)


def state(path):
    """`old`, `new`, `none` or `broken`."""
    if not path.exists():
        return "old" if grows(path) else "none"
    content = path.read_bytes()
    if content == OLD:
        return "old"
    return "new" if is_whole(path, content) else "broken"


def is_whole(path, content):
    """Whether a file that the command writes is complete."""
    if path.suffix in READ:
        try:
            return READ[path.suffix](content) is not False
        except Exception:  # whatever a reader makes of half a file
            return False
    if path.suffix == ".csv":
        rows = content.split(b"\n")
        return rows[-1] == b"" and len({row.count(b",") for row in rows[:-1]}) == 1 and len(rows) == 2 + ROWS[path.name]
    return content.rstrip().endswith(ENDS[path.suffix])


def chunks(content):
    """Names of the chunks of a PNG file that are complete."""
    place = 8
    while place + 12 <= len(content):
        (length,) = struct.unpack(">I", content[place : place + 4])
        if place + 12 + length > len(content):
            return
        yield content[place + 4 : place + 8]
        place += 12 + length


def checked(content):
    """Whether the checksum at the end of a stepper file, FNV-1a, is that of all bytes before."""
    check = 0xCBF29CE484222325
    for byte in content[:-8]:
        check = (check ^ byte) * 0x100000001B3 % (1 << 64)
    return check == int.from_bytes(content[-8:], "little")


READ = {
    ".json": json.loads,
    ".png": lambda content: list(chunks(content))[-1:] == [b"IEND"],
    ".toml": lambda content: "controller" in tomllib.loads(content.decode()),
    ".mat": lambda content: "K_D" in scipy.io.loadmat(BytesIO(content)),
    ".wav": lambda content: len(content) == 8 + struct.unpack("<I", content[4:8])[0],
    ".fmu": lambda content: zipfile.ZipFile(BytesIO(content)).testzip() is None,
    ".stepper": checked,
}
"""What reads a format to its end, by suffix."""
