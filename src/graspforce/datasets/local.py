"""The engine of one machine: a thread a core, each with one part at a time.

Files are read front to back under a lock by whichever thread is free. Arrow decodes and writes, and
the core solves, without the interpreter's lock.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import closing

from graspforce.datasets.sources import Chunk
from graspforce.datasets.target import Counts, Part
from graspforce.datasets.work import Failure, Work, Worker


def run_parts(
    work: Work, parts: Sequence[Part], threads: int, done: Callable[[Part, Counts], None]
) -> list[str]:
    """Do parts, and return what kept some from being done.

    Args:
        work: of which they are parts.
        parts: in their order.
        threads: how many.
        done: called after each part.
    """
    queue = _Queue(work, parts, done)
    with closing(queue), ThreadPoolExecutor(threads, "graspforce-part") as pool:
        try:
            futures = [pool.submit(queue.work_off) for _ in range(threads)]
            wait(futures, return_when=FIRST_EXCEPTION)
        finally:  # also where a signal ends the wait
            queue.stopped = True
    for future in futures:
        future.result()
    return queue.failures


class _Queue:
    """Gives parts with their rows to threads, each once."""

    def __init__(
        self, work: Work, parts: Sequence[Part], done: Callable[[Part, Counts], None]
    ) -> None:
        self._parts, self._worker, self._done = iter(parts), Worker(work), done
        self._reading, self._telling = threading.Lock(), threading.Lock()
        self._unreadable: set[int] = set()
        self.failures: list[str] = []
        self.stopped = False

    def close(self) -> None:
        self._worker.close()

    def work_off(self) -> None:
        while (given := self._next()) is not None:
            part, chunk = given
            counts = self._worker.finish(part, chunk)
            with self._telling:
                if isinstance(counts, Failure):
                    self.stopped = True
                    self.failures.append(counts.text)
                else:
                    self._done(part, counts)

    def _next(self) -> tuple[Part, Chunk] | None:
        with self._reading:
            for part in self._parts:
                if self.stopped:
                    break
                if part.file in self._unreadable:
                    continue
                chunk = self._worker.read(part)
                if not isinstance(chunk, Failure):
                    return part, chunk
                self._unreadable.add(part.file)
                self.failures.append(chunk.text)
        return None
