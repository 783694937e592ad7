"""Replace a file as a whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: str | Path) -> Generator[Path]:
    """Give a temporary path to write to, which takes the place of ``path`` at a clean end.

    When the block raises, whatever ``path`` held is still there and the temporary file is gone.

    Args:
        path: the file to make or to replace; a symbolic link stays one.

    Raises:
        OSError: the file cannot be written; it names ``path``.
    """
    target = Path(path).resolve()
    # Beside the target, because a rename is atomic only within one file system.
    temporary = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        try:
            yield temporary
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
