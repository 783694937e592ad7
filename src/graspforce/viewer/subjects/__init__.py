"""What a page can be about, one file a kind. What a kind needs is imported when it is opened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from graspforce.errors import InvalidInputError
from graspforce.viewer.moment import Look, Subject


class Begun(NamedTuple):
    """What a page can show at once."""

    shown: Subject | Look
    """The subject, or what stands for it until it is made."""
    finish: Callable[[], Subject] | None = None
    """Makes the subject, which takes seconds; None where it is shown."""

    def finished(self) -> Subject:
        """Return the subject, made if it has to be.

        Raises:
            InvalidInputError, ModelImportError: a hand does not get hold of its object, with what
                is missing; a log of another scene.
        """
        if self.finish is not None:
            return self.finish()
        assert not isinstance(self.shown, Look)  # which has a finish
        return self.shown


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
    return begin_subject(name, log).finished()


def begin_subject(name: str, log: str | Path | None = None) -> Begun:
    """Return what a page is about, a hand as it stands open; arguments and errors as above."""
    path = Path(name)
    if log is None and path.suffix:
        return _file(path)
    from graspforce import scenarios

    if log is None and name in scenarios.NAMES:
        from graspforce.viewer.subjects.scenario import ScenarioSubject

        return Begun(ScenarioSubject(scenarios.get(name)))
    if log is None and path.is_file():
        return _file(path)
    from graspforce import sim
    from graspforce.viewer.subjects.trial import TrialSubject

    scene, hand = name.removeprefix("sim/"), name.removeprefix("hand/")
    if scene in sim.NAMES:
        return Begun(TrialSubject(sim.get(scene), name, None if log is None else sim.Log.load(log)))
    if hand != name and hand in sim.HANDS:
        return _closing(sim.hand_model(hand), "object", name, f"{hand} hand", log)
    scenes = [f"sim/{each}" if each in scenarios.NAMES else each for each in sim.NAMES]
    hands = [f"hand/{each}" for each in sim.HANDS]
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
    return begin_scene(path, body, log).finished()


def begin_scene(path: str | Path, body: str, log: str | Path | None = None) -> Begun:
    """Return a scene of the user's with the hand open; arguments and errors as above."""
    from graspforce import sim

    stem = Path(path).stem
    return _closing(sim.load(path), body, stem, stem, log)


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


def _file(path: Path) -> Begun:
    from graspforce import files
    from graspforce.viewer.subjects.file import FileSubject

    return Begun(FileSubject(path.name, files.read(path)))


def _closing(model: Any, body: str, title: str, name: str, log: str | Path | None) -> Begun:
    from graspforce import sim
    from graspforce.viewer.subjects import closing
    from graspforce.viewer.subjects.trial import TrialSubject

    look = closing.open_hand(model, body, title)
    played = None if log is None else sim.Log.load(log)
    return Begun(look, lambda: TrialSubject(sim.own(model, body, name=name), title, played))
