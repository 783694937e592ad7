"""What compiled libraries print on the process's stderr, past Python's."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager

_STDERR = 2


@contextmanager
def native_stderr() -> Generator[Callable[[], str]]:
    """Hold back what is printed on the process's stderr; without an exception it comes at the end.

    That is the whole process's: what other threads print meanwhile is held back with it. A caller
    who raises puts what was printed into the exception.

    Yields:
        a function that returns what was printed so far.
    """
    try:
        stderr = os.dup(_STDERR)
    except OSError:  # the process has none: nothing is printed
        yield str
        return
    with tempfile.TemporaryFile() as held:

        def said() -> str:
            held.seek(0)
            return held.read().decode(errors="replace")

        os.dup2(held.fileno(), _STDERR)
        try:
            yield said
        finally:
            os.dup2(stderr, _STDERR)
            os.close(stderr)
        os.write(_STDERR, said().encode())
