"""What a page can be about, one file a kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from graspforce import files, scenarios
from graspforce.errors import InvalidInputError
from graspforce.viewer.moment import Subject
from graspforce.viewer.subjects.file import FileSubject
from graspforce.viewer.subjects.scenario import ScenarioSubject


def open_subject(name: str, log: str | Path | None = None) -> Subject:
    """Return what a page is about.

    Args:
        name: a scenario of the paper, a scene of ``graspforce.sim``, ``hand/`` and one of
            ``graspforce.sim.HANDS``, or the path of a file of grasps. ``sim/regrasp`` is the scene
            where a scenario has the same name.
        log: of a scene's only trial, an .npz, which is played in place of a run.

    Raises:
        InvalidInputError: an unknown name; the text lists the valid ones. A file that cannot be
            read, or is none of grasps. A log of what is no scene, or of another one.
        MissingExtraError: a simulated scene, and MuJoCo is not installed.
    """
    path = Path(name)
    is_file = path.suffix != "" or path.is_file()
    if log is None and name in scenarios.NAMES:
        return ScenarioSubject(scenarios.get(name))
    if log is None and is_file:
        return FileSubject(path.name, files.read(path))
    from graspforce.viewer.subjects import trial

    found = None if is_file else trial.trials(name)
    if found is not None:
        return trial.TrialSubject(found, name, log)
    scenes = [f"sim/{each}" if each in scenarios.NAMES else each for each in trial.SCENES]
    hands = [f"hand/{each}" for each in trial.HANDS]
    expected = [*scenes, *hands] if log is not None else [*scenarios.NAMES, *scenes, *hands]
    file = "a scene to the log, one of" if log is not None else "a file of grasps or one of"
    raise InvalidInputError(f"name: got {name!r}, expected {file} {', '.join(expected)}")


def open_scene(path: str | Path, body: str, log: str | Path | None = None) -> Subject:
    """Return a scene of the user's in physics: the hand closes on the object and holds it.

    Args:
        path: an MJCF file with hand and object.
        body: the object's name.
        log: of the scene, an .npz, which is played in place of a run.

    Raises:
        InvalidInputError, ModelImportError, MissingExtraError: as :func:`graspforce.sim.own`; a log
            of another scene.
    """
    from graspforce.viewer.subjects import trial

    return trial.TrialSubject(trial.own(path, body), Path(path).stem, log)


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
