"""Write a file as a whole or not at all, and nothing but files.

:func:`atomic_write` is how every file of the package is written. The new content goes to a private
folder beside the file and takes its place with one rename, so nobody reads half of it, and an error
before the rename leaves the old content. Pipes, terminals and other character devices are never
replaced: they get the finished bytes as a stream.

The other functions find out before any long work whether that will do.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from graspforce.errors import InvalidInputError

# How long to wait for a reader of a pipe, which may have been started at the same time; without a
# limit a pipe that nobody reads would block for ever.
READER_TIMEOUT = 5.0  # [s]

_PREFIX = ".graspforce-"


@contextmanager
def atomic_write(path: str | Path) -> Generator[Path]:
    """Give a temporary path to write to, whose content goes to ``path`` at a clean end.

    When the block raises, whatever ``path`` held is still there and the temporary file is gone. A
    file that is replaced leaves its mode, extended attributes and, where permitted, its owner to
    the new one; other hard links to it keep the old content.

    Args:
        path: the file to make or to replace, where a symbolic link stays one; or a pipe or a
            character device to write to, also ``/dev/stdout`` or ``/dev/fd/N``.

    Yields:
        A path with the same file name in a folder that only this user can enter.

    Raises:
        InvalidInputError: ``path`` is a directory, a socket or a block device.
        OSError: it cannot be written; the error names ``path``.
    """
    path = Path(path)
    try:
        target = None if _is_stream(path) else _target(path)
        with _private_folder(target) as folder:
            # The name is no longer than the target's, and its suffix decides on the format.
            temporary = Path(folder, path.name)
            yield temporary
            if target is None:
                _copy(temporary, path)
            else:
                _replace(target, temporary)
    except OSError as error:
        cause = error.strerror or error
        raise OSError(error.errno, f"cannot write it: {cause}", str(path)) from error


def check_writable(path: str | Path) -> None:
    """Confirm, before any long work, that :func:`atomic_write` can write to ``path``.

    Raises:
        InvalidInputError: it cannot: a directory, a socket, a block device, a file or folder that
            must not be written to, or a place in a directory that is not there.
    """
    path = Path(path)
    try:
        if not _is_stream(path):
            target = _target(path)
            if not target.parent.is_dir():
                raise InvalidInputError(f"{path}: the directory {target.parent} does not exist")
            with _private_folder(target):
                pass
    except OSError as error:
        raise InvalidInputError(f"{path}: cannot write it: {error.strerror or error}") from error


def check_output(path: str | Path, endings: Sequence[str] = (".json", ".npz", ".csv")) -> None:
    """Confirm, before any long work, that ``path`` is a place for results.

    Args:
        path: where results shall go.
        endings: of the file's name, those that will do.

    Raises:
        InvalidInputError: another ending; a directory, a socket or a block device; a file or
            folder that must not be written to, or a folder that is not there.
    """
    path = Path(path)
    if path.suffix.lower() not in endings:
        raise InvalidInputError(
            f"{path}: got a file name ending in {path.suffix!r}, expected one in "
            f"{' or '.join(endings)}"
        )
    check_writable(path)


def make_folder(path: str | Path, name: str) -> Path:
    """Make the folder, unless it is there, and confirm that files can be made in it.

    Args:
        path: the folder.
        name: the argument that it came as, for the error's text.

    Raises:
        InvalidInputError: it is no folder to write into.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=_PREFIX, dir=path):
            return path
    except OSError as error:
        raise InvalidInputError(
            f"{name}: got {path}, expected a folder to write into ({error.strerror or error})"
        ) from error


# ---- what a path leads to ----------------------------------------------------------------------


def _is_stream(path: Path) -> bool:
    """Return whether bytes go to what ``path`` leads to, and not into its place.

    Raises:
        InvalidInputError: it is nothing to write to.
        OSError: it cannot be reached, or must not be written to.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:  # nothing there, or not where a link points
        return False
    if _own_descriptor(path) is not None:
        return True
    kinds = {stat.S_IFDIR: "a directory", stat.S_IFSOCK: "a socket", stat.S_IFBLK: "a block device"}
    if stat.S_IFMT(mode) in kinds:
        raise InvalidInputError(f"{path}: got {kinds[stat.S_IFMT(mode)]}, expected a file to write")
    if not os.access(path, os.W_OK):  # a rename would not ask
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return not stat.S_ISREG(mode)


def _own_descriptor(path: Path) -> int | None:
    """Return N where ``path`` leads to /dev/fd/N, a file that this process has open, else None.

    To replace such a file would cut off whoever writes to it through the descriptor, such as the
    shell that redirected standard output.

    Args:
        path: one that ``stat`` can follow, so that its links have an end.
    """
    folders = rf"/dev/fd|/proc/{os.getpid()}(/task/\d+)?/fd"
    while True:
        if path.name.isdecimal() and re.fullmatch(folders, os.path.realpath(path.parent)):
            return int(path.name)
        if not path.is_symlink():
            return None
        path = path.parent / path.readlink()


def _target(path: Path) -> Path:
    """Return the file that ``path`` stands for, through symbolic links, there or not."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


# ---- how it gets its content -------------------------------------------------------------------


def _private_folder(target: Path | None) -> TemporaryDirectory[str]:
    """Return a folder of this user's own beside the target; anywhere where there is none.

    It is beside the target because a rename is atomic only within one file system. What is made
    in it has the mode, group and access list that a file made beside the target would have.
    """
    beside = None if target is None else target.parent
    try:
        return TemporaryDirectory(prefix=_PREFIX, dir=beside, ignore_cleanup_errors=True)
    except OSError as error:
        where = "a temporary folder" if beside is None else str(beside)
        raise OSError(
            error.errno, f"no file can be made in {where} ({error.strerror or error})"
        ) from error


def _replace(target: Path, new: Path) -> None:
    with new.open("r+b") as file:
        if target.exists():
            _copy_attributes(target, new)
        # Without this a crash of the machine could leave the name with half the content.
        os.fsync(file.fileno())
    os.replace(new, target)


def _copy_attributes(old: Path, new: Path) -> None:
    """Give the new file the owner, mode and extended attributes of the old one."""
    was = old.stat()
    if hasattr(os, "chown"):
        for owner, group in ((was.st_uid, -1), (-1, was.st_gid)):
            with suppress(OSError):  # only root may give files away
                os.chown(new, owner, group)
    shutil.copystat(old, new)
    os.utime(new)  # copystat has also copied the time of the last change
    now = new.stat()
    if (now.st_uid, now.st_gid) != (was.st_uid, was.st_gid):
        os.chmod(new, stat.S_IMODE(was.st_mode) & 0o777)  # set-user-ID would now run as this user


def _copy(source: Path, stream: Path) -> None:
    with source.open("rb") as content, open(_open_stream(stream), "wb") as output:
        shutil.copyfileobj(content, output)


def _open_stream(path: Path) -> int:
    """Open a pipe or a device for writing, without making or emptying anything."""
    own = _own_descriptor(path)
    if own is not None:
        return os.dup(own)  # shares the place in the file with whoever else writes to it
    if not path.is_fifo():
        return os.open(path, os.O_WRONLY)
    end = time.monotonic() + READER_TIMEOUT
    while True:
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            if time.monotonic() > end:
                raise OSError(errno.ENXIO, "no process reads this pipe") from error
            time.sleep(0.02)
        else:
            os.set_blocking(descriptor, True)
            return descriptor
