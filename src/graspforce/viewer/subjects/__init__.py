"""What a page can be about, one file a kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from graspforce import files, scenarios
from graspforce.errors import InvalidInputError
from graspforce.viewer.moment import Subject
from graspforce.viewer.subjects.file import FileSubject
from graspforce.viewer.subjects.scenario import ScenarioSubject


def open_subject(name: str) -> Subject:
    """Return what a page is about.

    Args:
        name: a scenario of the paper, a scene of ``graspforce.sim``, or the path of a file of
            grasps. ``sim/regrasp`` is the scene where a scenario has the same name.

    Raises:
        InvalidInputError: an unknown name; the text lists the valid ones. A file that cannot be
            read, or is none of grasps.
        MissingExtraError: a simulated scene, and MuJoCo is not installed.
    """
    if name in scenarios.NAMES:
        return ScenarioSubject(scenarios.get(name))
    path = Path(name)
    if path.suffix or path.exists():
        return FileSubject(path.name, files.read(path))
    from graspforce.viewer.subjects.trial import SCENES, open_trial

    scene = name.removeprefix("sim/")
    if scene in SCENES:
        return open_trial(scene)
    scenes = [f"sim/{each}" if each in scenarios.NAMES else each for each in SCENES]
    raise InvalidInputError(
        f"name: got {name!r}, expected a file of grasps or one of "
        f"{', '.join((*scenarios.NAMES, *scenes))}"
    )


def open_hand(
    path: str | Path, fingertips: Sequence[str] = (), tau_max: float | None = None
) -> Subject:
    """Return a hand from an MJCF or URDF file, with an object on which contacts are picked.

    Args:
        path: the file.
        fingertips: links; by default the last ones of the chains that motors move.
        tau_max: limit of every motor in place of the file's [N·m, N].

    Raises:
        ModelImportError, InvalidInputError, MissingExtraError: as the readers of hands.
    """
    from graspforce.viewer.subjects.hand import HandSubject

    return HandSubject(path, fingertips, tau_max)
