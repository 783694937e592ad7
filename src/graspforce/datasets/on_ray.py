"""The engine of several machines: Ray Data hands parts to workers that read and write.

Only the parts' places and counts go through Ray. Where a worker dies, Ray starts another, which
does what is missing of its parts.
"""

from __future__ import annotations

import logging
import math
import os
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

from graspforce.datasets.target import Counts, Part
from graspforce.datasets.work import Failure, Work, Worker
from graspforce.errors import MissingExtraError

# Parts that a worker is given at once: neighbours, so that it reads its file front to back.
_AT_ONCE = 4


class _RayWorker:
    """A worker in a process of its own, somewhere in the cluster."""

    def __init__(self, work: Work) -> None:
        self._worker = Worker(work)

    def __call__(self, batch: dict[str, Any]) -> dict[str, list[Any]]:
        """Do parts; a row for each, with its counts, or with why it is not done."""
        parts = [
            Part(*map(int, row))
            for row in zip(*(batch[name] for name in Part.__annotations__), strict=True)
        ]
        rows = [_as_row(part, self._worker.do_if_missing(part)) for part in parts]
        return {name: [row[name] for row in rows] for name in rows[0]}


def _as_row(part: Part, found: Counts | Failure) -> dict[str, Any]:
    failed = isinstance(found, Failure)
    counts = Counts() if failed else found
    return asdict(part) | {
        "rows": counts.rows, "rejected": counts.rejected, "held": counts.held,
        "names": list(counts.statuses), "numbers": list(counts.statuses.values()),
        "failure": found.text if failed else "", "unreadable": failed and found.unreadable,
    }  # fmt: skip


def ray_module() -> Any:
    """Return the module.

    Raises:
        MissingExtraError: Ray is not installed.
    """
    try:
        import ray  # pyright: ignore[reportMissingImports]
        import ray.data  # pyright: ignore[reportMissingImports, reportUnusedImport]
    except ModuleNotFoundError as error:
        raise MissingExtraError("engine 'ray'", "ray", "ray") from error
    return ray


def run_parts(
    work: Work, parts: Sequence[Part], address: str | None, done: Callable[[Part, Counts], None]
) -> list[str]:
    """Do parts, and return what kept some from being done.

    Args:
        work: of which they are parts.
        parts: in their order.
        address: of the cluster; None for one that is started here, or is running.
        done: called after each part.
    """
    module = ray_module()
    failures: list[str] = []
    with _running(module, address):
        cores = max(1, int(module.cluster_resources().get("CPU", 1)))
        blocks = math.ceil(len(parts) / min(_AT_ONCE, math.ceil(len(parts) / cores)))
        rows = module.data.from_items([asdict(part) for part in parts], override_num_blocks=blocks)
        found = rows.map_batches(
            _RayWorker, batch_size=None, fn_constructor_args=(work,), num_cpus=1,
            compute=module.data.ActorPoolStrategy(min_size=1, max_size=cores),
        )  # fmt: skip
        try:
            for row in found.iter_rows():
                part = Part(*(row[name] for name in Part.__annotations__))
                if row["failure"]:
                    failures.append(row["failure"])
                    if not row["unreadable"]:
                        break
                    continue
                statuses = Counter(dict(zip(row["names"], row["numbers"], strict=True)))
                done(part, Counts(row["rows"], row["rejected"], statuses, row["held"]))
        except module.exceptions.RayTaskError:  # an error of ours in a worker
            raise
        except module.exceptions.RayError as error:
            failures.append(f"Ray: {' '.join(str(error).split())[:300]}")
    return failures


@contextmanager
def _running(module: Any, address: str | None) -> Generator[None]:
    """Join a cluster, or start Ray, and leave it as it was."""
    if module.is_initialized():
        yield
        return
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address is None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        quiet["include_dashboard"] = False
    module.init(address=address, **quiet)
    context = module.data.DataContext.get_current()
    context.enable_progress_bars = False
    logging.getLogger("ray.data").setLevel(logging.ERROR)
    try:
        yield
    finally:
        module.shutdown()
