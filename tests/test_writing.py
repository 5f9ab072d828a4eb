"""A file is the old one or the new one, whole, and errors name it."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ambid.errors import InputError, OutputError
from ambid.writing import make_folder, require_writable, whole_file


@pytest.fixture
def old(tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(b"old")
    return path


def alone(path):
    """Whether no other file is beside it."""
    return os.listdir(path.parent) == [path.name]


def _begin(stream, error):
    stream.write(b"ne")
    raise error


def write(path, content=b"new"):
    with whole_file(path) as stream:
        stream.write(content)


def test_the_old_file_stands_until_the_new_one_is_complete(old):
    with whole_file(old) as stream:
        stream.write(b"new")
        stream.flush()
        assert old.read_bytes() == b"old"
    assert old.read_bytes() == b"new"
    assert alone(old)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_whatever_goes_wrong_leaves_the_old_file_alone(error, old):
    with pytest.raises(error), whole_file(old) as stream:
        _begin(stream, error)
    assert old.read_bytes() == b"old"
    assert alone(old)


def test_a_full_disk_is_named_with_the_file(old, golden):
    with golden.raises(OutputError), whole_file(old):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert old.read_bytes() == b"old"
    assert alone(old)


def test_permissions_are_kept_and_those_of_a_new_file_are_the_usual_ones(old):
    old.chmod(0o640)
    write(old)
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    usual = old.with_name("usual")
    usual.touch()
    write(old.with_name("b.json"))
    assert stat.S_IMODE(old.with_name("b.json").stat().st_mode) == stat.S_IMODE(usual.stat().st_mode)


def test_a_symbolic_link_stays_and_leads_to_the_new_file(old, tmp_path):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    link = folder / "link.json"
    link.symlink_to(old)
    write(link)
    assert link.is_symlink()
    assert old.read_bytes() == b"new"
    assert alone(link)


def test_a_hard_link_keeps_the_old_content(old):
    other = old.with_name("other")
    other.hardlink_to(old)
    write(old)
    assert (old.read_bytes(), other.read_bytes()) == (b"new", b"old")


def test_a_device_takes_the_content(tmp_path, golden):
    write(Path(os.devnull))
    with golden.raises(OutputError):
        write(Path("/dev/full"))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        write(pipe)
        assert reader.communicate()[0] == b"new"
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize(
    ("name", "error"),
    [(".", InputError), ("none/a.json", InputError), ("a.json/b.json", InputError), ("x" * 300, OutputError)],
    ids=["a folder", "in no folder", "in a file", "a long name"],
)
def test_what_cannot_be_written_is_known_before(name, error, old):
    messages = set()
    for attempt in (require_writable, write):
        with pytest.raises(error) as caught:
            attempt(old.parent / name)
        messages.add(str(caught.value))
    assert len(messages) == 1
    assert messages.pop().startswith(str((old.parent / name).parent))
    assert alone(old)


@pytest.mark.skipif(os.access("/proc/version", os.W_OK) or os.geteuid() == 0, reason="root may write everywhere")
def test_write_protection_is_respected(old, golden):
    old.chmod(0o444)
    with pytest.raises(OutputError, match="write-protected"):
        write(old)
    old.chmod(0o644)
    old.parent.chmod(0o555)
    with golden.raises(OutputError):
        write(old)
    old.parent.chmod(0o755)


def test_a_file_in_the_place_of_a_folder(old, golden):
    for path in (old, old / "folder"):
        with golden.raises(InputError):
            make_folder(path)


def test_of_two_writers_at_once_the_last_wins_whole(tmp_path):
    """Two processes write the same file in a loop, while it is read."""
    path = tmp_path / "a.txt"
    program = (
        "import sys; from ambid.writing import whole_file\n"
        "for k in range(60):\n"
        "    with whole_file(sys.argv[1]) as stream:\n"
        "        for _ in range(20):\n"
        "            stream.write(sys.argv[2].encode() * 5000)\n"
    )
    write(path, b"a" * 100_000)
    writers = [subprocess.Popen([sys.executable, "-c", program, path, letter]) for letter in "ab"]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        content = path.read_bytes()
        assert len(content) == 100_000
        assert len(set(content)) == 1
        seen.add(content[:1])
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen == {b"a", b"b"}
    assert alone(path)
