"""graspforce: grasp forces for multi-fingered hands.

Find the contact forces c that give an object the wrench f (W c = f), stay inside the exact
friction cones and the joint torque limits, and sit where you want them between a firm grip and
a light one: the Weighted Barrier Function method of Borgstrom, Batalin, Sukhatme and Kaiser.

>>> import graspforce as gf
>>> contacts = [
...     gf.Contact(point=(0.04, 0, 0), normal=(-1, 0, 0), model=gf.PCWF(mu=0.5)),
...     gf.Contact(point=(-0.02, 0.03, 0), normal=(0.5, -0.75**0.5, 0), model=gf.PCWF(mu=0.5)),
...     gf.Contact(point=(-0.02, -0.03, 0), normal=(0.5, 0.75**0.5, 0), model=gf.PCWF(mu=0.5)),
... ]
>>> problem = gf.Grasp(contacts).problem(f=[0, 0, 2.5, 0, 0, 0], c_max=20)
>>> gf.solve(problem).status.name
'SOLVED'

Units are SI: N, N·m, m. The package's pages: ``docs/conventions.md`` first.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from graspforce._engine.outcome import Start, Status
from graspforce._engine.settings import Settings
from graspforce.certificate import Certificate, check_certificate
from graspforce.contact import FPC, PCWF, SFC, Contact, suction_cup
from graspforce.errors import (
    GraspForceError,
    GraspForceWarning,
    InvalidInputError,
    MissingExtraError,
    ModelImportError,
)
from graspforce.grasp import Grasp
from graspforce.grasp_map import grasp_map
from graspforce.problem import ForceProblem
from graspforce.servo import Servo
from graspforce.solution import (
    InfeasibleGraspError,
    NotConvergedError,
    Solution,
    SolveError,
    Verification,
)
from graspforce.solve import solve

if TYPE_CHECKING:
    from graspforce import (
        baselines,
        control,
        equations,
        files,
        guaranteed,
        hands,
        reference,
        regrasp,
        scenarios,
        sim,
        soles,
        trajectory,
    )
    from graspforce import warp as warp
    from graspforce.answers import firmness, payload, robust
    from graspforce.answers.diagnosis import diagnose
    from graspforce.batch import Batch, BatchVerification, iterate_many, solve_batch, solve_many
    from graspforce.derivatives import Sensitivity, sensitivity
    from graspforce.study import figures

__version__: str

__all__ = [
    "FPC",
    "PCWF",
    "SFC",
    "Batch",
    "BatchVerification",
    "Certificate",
    "Contact",
    "ForceProblem",
    "Grasp",
    "GraspForceError",
    "GraspForceWarning",
    "InfeasibleGraspError",
    "InvalidInputError",
    "MissingExtraError",
    "ModelImportError",
    "NotConvergedError",
    "Sensitivity",
    "Servo",
    "Settings",
    "Solution",
    "Start",
    "SolveError",
    "Status",
    "Verification",
    "baselines",
    "check_certificate",
    "control",
    "diagnose",
    "equations",
    "figures",
    "files",
    "firmness",
    "grasp_map",
    "guaranteed",
    "hands",
    "iterate_many",
    "payload",
    "reference",
    "regrasp",
    "robust",
    "scenarios",
    "sensitivity",
    "sim",
    "soles",
    "solve",
    "solve_batch",
    "solve_many",
    "suction_cup",
    "trajectory",
]

# Imported at first use, so that `import graspforce` stays as light as NumPy. `warp` is not in
# __all__: it needs its extra, and a star import must not.
_LAZY = {
    name: f"graspforce.{name}"
    for name in (
        "baselines",
        "control",
        "files",
        "guaranteed",
        "hands",
        "regrasp",
        "scenarios",
        "sim",
        "soles",
        "trajectory",
        "warp",
    )
} | {"figures": "graspforce.study.figures"}
_LAZY |= {name: f"graspforce.answers.{name}" for name in ("firmness", "payload", "robust")}
_LAZY_NAMES = {
    "Batch": "graspforce.batch",
    "BatchVerification": "graspforce.batch",
    "Sensitivity": "graspforce.derivatives",
    "diagnose": "graspforce.answers.diagnosis",
    "iterate_many": "graspforce.batch",
    "sensitivity": "graspforce.derivatives",
    "solve_batch": "graspforce.batch",
    "solve_many": "graspforce.batch",
}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return importlib.import_module(_LAZY[name])
    if name in _LAZY_NAMES:
        return getattr(importlib.import_module(_LAZY_NAMES[name]), name)
    if name == "__version__":
        from importlib.metadata import version  # as heavy as everything else together

        return version("graspforce")
    raise AttributeError(f"module 'graspforce' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
