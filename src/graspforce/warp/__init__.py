"""Grasp force problems by the million on a GPU, with NVIDIA Warp (extra ``gpu``).

:func:`solve` is :func:`graspforce.solve` for B problems of one layout whose numbers already are on
the device, beside a simulator or a network. :class:`Problems` holds them checked and bound, to be
solved again and again, and differentiated. ``docs/gpu.md`` tells how fast and how exact that is.
"""

from __future__ import annotations

from graspforce.errors import MissingExtraError

try:
    import warp  # noqa: F401  # pyright: ignore[reportUnusedImport]
except ModuleNotFoundError as error:
    raise MissingExtraError("graspforce.warp", "warp-lang", "gpu") from error

from graspforce.warp.problems import Forces, Problems, solve

__all__ = ["Forces", "Problems", "solve"]
