"""What stands between a problem and the C++ core: the buffer, the builds, what goes in and out.

``layout`` has the fields and where they stand in a problem's flat buffer, ``settings`` and
``outcome`` what a solve is asked for and what it hands back, ``native`` the choice among the builds
of the core, and ``dispatch`` the one between the core and the NumPy reference.
"""

from graspforce._engine.native import module, modules

__all__ = ["module", "modules"]
