"""A live 3-D page of a grasp, in the browser: forces that answer while one turns knobs.

:func:`open_subject` finds what a page is about, :class:`Viewer` serves it:

>>> from graspforce import viewer
>>> page = viewer.Viewer(viewer.open_subject("static"), port=0)
>>> page.url.startswith("http://127.0.0.1:")
True
>>> page.stop()

A hand closes on its object for seconds before there is a subject: :func:`begin_subject` gives a
:class:`Look` at it as it stands open, and :meth:`Viewer.turn_to` turns the pages to what it holds.

======================  ===============================================================
``subjects``            what is shown: scenarios, simulated scenes, files, hands
``knobs``               what can be turned, its ranges, its form in a link
``problems``            the force problem that the knobs make, and its answer
``scene``, ``shapes``   the drawing
``panel``, ``words``    widgets, numbers, sentences
``timeline``            forces over time
``remedy``              what would help, as knobs
``session``, ``server`` a client's thread; all clients
======================  ===============================================================

Needs the extra ``view``: in a checkout, ``pip install '.[view]'``.
"""

from __future__ import annotations

from graspforce.errors import MissingExtraError

try:
    import viser as _viser  # noqa: F401  # pyright: ignore[reportUnusedImport]
except ImportError as error:
    raise MissingExtraError("the live page", "viser", "view") from error

from graspforce.viewer.knobs import Knobs
from graspforce.viewer.moment import Look
from graspforce.viewer.server import DEFAULT_PORT, Viewer
from graspforce.viewer.subjects import (
    Begun,
    begin_scene,
    begin_subject,
    open_hand,
    open_scene,
    open_subject,
)

__all__ = [
    "DEFAULT_PORT",
    "Begun",
    "Knobs",
    "Look",
    "Viewer",
    "begin_scene",
    "begin_subject",
    "open_hand",
    "open_scene",
    "open_subject",
]
