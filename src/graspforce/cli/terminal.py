"""What every command prints with: one-line errors, progress on stderr, plain words."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from graspforce.errors import GraspForceError
from graspforce.outcome import Status

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def one_line_errors() -> Generator[None]:
    """Turn what the caller can put right into one line on stderr and exit code 2."""
    try:
        yield
    except BrokenPipeError:
        raise  # the reader of our output has had enough; Typer ends quietly
    except GraspForceError as error:
        typer.echo(f"graspforce: {error}", err=True)
        raise typer.Exit(2) from error
    except OSError as error:
        typer.echo(f"graspforce: {error.filename}: cannot write it: {error.strerror}", err=True)
        raise typer.Exit(2) from error


def stdout_console() -> Console:
    """Return stdout's console; in a pipe nothing is wrapped or cut to a width."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 10_000)


@contextmanager
def progress_bar(total: int, what: str) -> Generator[Callable[[int], None]]:
    """Show a progress bar on stderr, if that is a terminal; call what it gives after each item."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda index: progress.update(task, completed=index + 1)


@contextmanager
def stage_bars() -> Generator[Callable[[str, int, int], None]]:
    """Show a progress bar a stage on stderr, if that is a terminal."""
    from rich.console import Console
    from rich.progress import Progress, TaskID

    console = Console(stderr=True)
    tasks: dict[str, TaskID] = {}
    with Progress(console=console, disable=not console.is_terminal) as bars:

        def progress(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done)

        yield progress


@contextmanager
def status_line(what: str) -> Generator[Callable[[str], None]]:
    """Show a line on stderr, if that is a terminal; call what it gives to change the line."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _: None
        return
    with console.status(what) as status:
        yield status.update


def counts(what: str, statuses: Iterable[Status]) -> str:
    """Return how many there are and how many of each status, as in ``3 grasps: 3 solved``."""
    counts = Counter(words(status) for status in statuses)
    total = counts.total()
    each = ", ".join(f"{count} {words}" for words, count in counts.most_common())
    return f"{total} {what}{'' if total == 1 else 's'}: {each}"


def words(status: Status) -> str:
    """Return a status in words: ``wrench unreachable``."""
    return status.name.lower().replace("_", " ")


def printable(name: str) -> str:
    """Return a name on one line, without characters that steer a terminal."""
    return "".join(each if each.isprintable() else "�" for each in name)
