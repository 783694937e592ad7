"""What the process of a command sets up: standard streams, signals, its exit code."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

from graspforce.cli.terminal import one_line_errors


@contextmanager
def as_command() -> Generator[None]:
    """Run the block as the whole work of this process."""
    _open_standard_streams()
    _end_orderly_on_signals()
    # Where it keeps its cache, which it says without a home folder, is no result of a command.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        with one_line_errors():
            yield
    except BrokenPipeError:  # nobody reads the output any more
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        raise SystemExit(128 + signal.SIGINT) from None
    finally:
        _drop_unwritten_output()


def keep_freed_memory() -> None:
    """Let arrays of some megabytes take memory that others have freed, where glibc manages it.

    It gives such memory back to the system at once and gets it anew, page by page, each filled with
    zeros: ten times as many pages for the results of 100,000 grasps as they have.
    """
    mallopt: Any = getattr(ctypes.CDLL(None) if os.name == "posix" else None, "mallopt", None)
    if mallopt is not None:
        mallopt(-1, 2**30)  # M_TRIM_THRESHOLD: what may lie unused at the end of the heap
        mallopt(-3, 2**25)  # M_MMAP_THRESHOLD: from where on memory is asked for apart, at most


def _open_standard_streams() -> None:
    """Make sure that there are standard streams, and that stdout takes every character.

    The first files that are opened would else get the numbers of those that are closed, and what a
    library prints would go into them. In place of a closed stdout stands one that refuses what is
    written to it: results that nobody sees are an error, as on a full disk.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDONLY)  # gets the lowest free number, which is this one
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    reconfigure: Any = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        # A character that the terminal's encoding lacks must not cost the table.
        reconfigure(errors="replace")


def _end_orderly_on_signals() -> None:
    """Let SIGTERM and SIGHUP end the process like an exception, so that it can clean up."""

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise SystemExit(128 + number)

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            with suppress(ValueError):  # not in the main thread
                signal.signal(number, end)


def _drop_unwritten_output() -> None:
    """Drop what stdout did not take, which Python would try to write again at its end.

    That would fail again, and put another message and exit code in place of ours.
    """
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):  # as where a test stands in for stdout
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
