"""What every command prints with: results, one-line errors, progress on stderr, words for statuses.

Names, keys and paths come from files and may contain characters that control a terminal.
Exceptions and results keep them; what is printed passes through :func:`printable`, in the consoles
and in :func:`one_line_errors`.
"""

from __future__ import annotations

import sys
import unicodedata
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment

from graspforce._engine.outcome import Status
from graspforce.errors import GraspForceError, GraspForceWarning


def printable(text: str, keep: str = "") -> str:
    """Return the text on one line, without characters that control a terminal.

    Control characters, marks of the direction of writing, other invisible ones and lone surrogates
    are replaced; spaces of any width are none.

    Args:
        text: what shall be printed.
        keep: characters that stay in any case.
    """
    return "".join(
        each if each.isprintable() or each in keep or unicodedata.category(each) == "Zs" else "�"
        for each in text
    )


class _Console(Console):
    """A console on which only its own styles control the terminal."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            text = segment.text if segment.control else printable(segment.text, keep="\n")
            yield Segment(text, segment.style, segment.control)

    def on_broken_pipe(self) -> None:
        raise  # the BrokenPipeError, which ends the command as Typer ends it


# ---- results -----------------------------------------------------------------------------------


def stdout_console() -> Console:
    """Return stdout's console; in a pipe nothing is wrapped or cut to a width."""
    width = None if sys.stdout.isatty() else 10_000
    return _Console(highlight=False, markup=False, emoji=False, width=width)


def show(*parts: RenderableType, wrap: bool = True) -> None:
    """Print tables and texts on stdout.

    Args:
        parts: what to print, one below the other; each text is one line.
        wrap: whether a text is broken between words at the terminal's width.

    Raises:
        OSError: standard output is closed, or cannot take it.
    """
    console = stdout_console()
    try:
        for part in parts:
            text_or_table = printable(part) if isinstance(part, str) else part
            console.print(text_or_table, soft_wrap=not wrap)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(
            error.errno, f"cannot write to it: {error.strerror}", "standard output"
        ) from error


@contextmanager
def reporting(report: Callable[[], None]) -> Generator[Callable[[str], None]]:
    """Call ``report`` after a block that keeps results in files, whether or not that works.

    The files come first, because standard output may be closed, or on a disk that is full. When
    both fail, the error is that of the block. The block is given a function to call with a line
    for each file that is written; the lines are printed last.
    """
    lines: list[str] = []

    def print_all() -> None:
        report()
        show(*lines, wrap=False)

    try:
        yield lines.append
    except Exception:
        with suppress(OSError):
            print_all()
        raise
    print_all()


# ---- errors ------------------------------------------------------------------------------------


@contextmanager
def one_line_errors() -> Generator[None]:
    """Turn errors that the caller can correct into one line on stderr and exit code 2.

    A warning of a slip is one line, too, and changes no exit code.
    """
    try:
        with warnings.catch_warnings():
            show_others = warnings.showwarning

            def show_warning(message: Warning | str, category: type[Warning], *place: Any) -> None:
                if issubclass(category, GraspForceWarning):
                    tell(f"warning: {message}")
                else:
                    show_others(message, category, *place)

            warnings.showwarning = show_warning
            yield
    except GraspForceError as error:
        _fail(str(error), error)
    except OSError as error:
        if isinstance(error, BrokenPipeError) and error.filename is None:
            raise  # nobody reads the output any more; Typer ends quietly
        where = "" if error.filename is None else f"{error.filename}: "
        _fail(f"{where}{error.strerror or error}", error)
    except Exception as error:
        # An error of usage, which Typer prints, quotes the arguments. By Typer's version its class
        # is Click's or Typer's own.
        usage: Any = error
        if isinstance(getattr(usage, "message", None), str):
            usage.message = printable(usage.message, keep="\n")
        raise


def tell(text: str) -> None:
    """Print one line on stderr, as of an error or a warning."""
    with suppress(OSError):  # stderr may be full, too
        typer.echo(f"graspforce: {printable(text)}", err=True)


def _fail(text: str, error: Exception) -> NoReturn:
    tell(text)
    raise SystemExit(getattr(error, "exit_code", 2)) from error


# ---- progress ----------------------------------------------------------------------------------


def _stderr_console() -> Console:
    return _Console(stderr=True)


@contextmanager
def progress_bar(total: int, what: str) -> Generator[Callable[[int], None]]:
    """Show a progress bar on stderr, if that is a terminal; tell it the number that is done."""
    from rich.progress import Progress

    console = _stderr_console()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=done)


@contextmanager
def stage_bars() -> Generator[Callable[[str, int, int], None]]:
    """Show a progress bar a stage on stderr, if that is a terminal."""
    from rich.progress import Progress, TaskID

    console = _stderr_console()
    tasks: dict[str, TaskID] = {}
    with Progress(console=console, disable=not console.is_terminal) as bars:

        def progress(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(escape(stage), total=total)
            bars.update(tasks[stage], completed=done)

        yield progress


@contextmanager
def progress_columns(what: str) -> Generator[Callable[[int, int, str], None]]:
    """Show how many are done, how many a second, the time left and a text, if that is a terminal.

    What it gives is called with the number done, the number of all, and the text.
    """
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text("" if task.speed is None else f"{task.speed:,.0f} {what}/s")

    console = _stderr_console()
    columns = (
        MofNCompleteColumn(),
        BarColumn(20),
        Rate(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        task = bars.add_task("", total=None)
        yield lambda done, total, text: bars.update(
            task, completed=done, total=total, description=text
        )


@contextmanager
def status_line(what: str) -> Generator[Callable[[str], None]]:
    """Show a line on stderr, if that is a terminal; call what it gives to change the line."""
    console = _stderr_console()
    if not console.is_terminal:
        yield lambda _: None
        return
    with console.status(what) as status:
        yield status.update


# ---- words -------------------------------------------------------------------------------------


def counts(what: str, statuses: Iterable[int]) -> str:
    """Return how many there are and how many of each status, as in ``3 grasps: 3 solved``.

    Args:
        what: a grasp, or what else there are.
        statuses: values of :class:`graspforce.Status`.
    """
    counts = Counter(statuses)
    total = counts.total()
    each = ", ".join(
        f"{count} {status_words(Status(status))}" for status, count in counts.most_common()
    )
    return f"{total} {what}{'' if total == 1 else 's'}: {each}"


def status_words(status: Status) -> str:
    """Return a status in words: ``wrench unreachable``."""
    return status.name.lower().replace("_", " ")
