"""What the benchmarks share: a table on the screen and, with ``--save``, in a file."""

from __future__ import annotations

import argparse
import datetime
from pathlib import Path

from rich.console import Console, RenderableType

from graspforce.report.machine import describe_machine


def writable(name: str) -> Path:
    """Return the path of a file to write, found to be one before minutes of work; for argparse."""
    path = Path(name)
    there = path.exists()
    try:
        path.open("a").close()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"cannot write {name}: {error.strerror}") from error
    if not there:
        path.unlink()
    return path


def show(table: RenderableType, save: Path | None, width: int) -> None:
    """Print a table with machine and date, and write both to a file."""
    machine = describe_machine()
    about = (
        f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}, "
        f"{datetime.date.today()}"
    )
    Console().print(table, about)
    if save is not None:
        with save.open("w", encoding="utf-8") as file:
            Console(file=file, width=width).print(table, about)
