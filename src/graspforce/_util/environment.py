"""What measured times depend on: the machine and the versions."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

# The packages that baselines call, as they are called in an index.
SOLVERS = ("clarabel", "daqp", "ecos", "highspy", "moreau", "qoco", "scipy", "scs")


def describe_machine() -> dict[str, Any]:
    """Return what the times depend on: processor, operating system, versions."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "solvers": _versions(SOLVERS),
    }


def _versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of those packages that are installed."""
    found: dict[str, str] = {}
    for package in packages:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def describe_run() -> dict[str, Any]:
    """Return what a file of results begins with: version, date and time in UTC, machine."""
    return {
        "graspforce": _versions(("graspforce",)).get("graspforce", "not installed"),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
    }


def _cpu_model() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return named[1] if named else platform.processor() or platform.machine()
