"""What the benchmarks share: a table on the screen and, with ``--save``, in a file."""

from __future__ import annotations

import argparse
import datetime
from pathlib import Path

from rich.console import Console, RenderableType

from graspforce._util.atomic import atomic_write, check_writable
from graspforce._util.environment import describe_machine
from graspforce.cli import terminal
from graspforce.errors import InvalidInputError


def writable(name: str) -> Path:
    """Return the path of a file to write, found to be one before minutes of work; for argparse."""
    try:
        check_writable(name)
    except InvalidInputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(name)


def show(*parts: RenderableType, save: Path | None, width: int, append: bool = False) -> None:
    """Write tables and lines, then machine and date, to a file, and print them.

    Args:
        parts: what to write, one below the other.
        save: the file, if any.
        width: of a line in the file.
        append: whether what the file holds stays, above.
    """
    machine = describe_machine()
    about = (
        f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}, "
        f"{datetime.date.today()}"
    )
    with terminal.reporting(lambda: terminal.show(*parts, about)):
        if save is not None:
            before = save.read_text(encoding="utf-8") if append and save.is_file() else ""
            with atomic_write(save) as temporary, temporary.open("w", encoding="utf-8") as file:
                file.write(before)
                Console(file=file, width=width).print(*parts, about, sep="\n")
