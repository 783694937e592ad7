"""A scene or a recording as an HTML page that needs nothing else, by viser's serializer."""

from __future__ import annotations

from collections.abc import Iterable

from viser import ViserServer

from graspforce.viewer.knobs import Knobs
from graspforce.viewer.moment import Subject
from graspforce.viewer.problems import answer
from graspforce.viewer.scene import Scene, aim, dress, quiet

FRAME_RATE = 20.0  # of a recording [1/s]
MOST_FRAMES = 200


def html(subject: Subject, knobs: Knobs, moving: bool = False) -> str:
    """Return a page that shows a subject and can be turned, and opens without a network.

    Args:
        subject: what is shown.
        knobs: where they stand.
        moving: whether it goes through ``subject.times``, in real time, over and over.

    Raises:
        InvalidInputError: the knobs ask for what cannot be.
    """
    times = frame_times(subject) if moving else (knobs.time,)
    # A serializer belongs to a server; this one listens to this machine alone and to nobody.
    with quiet():
        server = ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        dress(server.scene)
        aim(server.initial_camera, subject)
        scene = Scene(server.scene, subject)
        serializer = None
        for t in times:
            now = knobs.changed(time=t)
            moment = subject.moment(now)
            while subject.busy:  # a scene in physics, which is run when its time is asked for
                subject.work(0.1)
                moment = subject.moment(now)
            found = None if moment.problem is None else answer(moment.problem, now)
            scene.show(subject.bodies(now), moment, found)
            if serializer is None:
                serializer = server.get_scene_serializer()
            if moving:
                serializer.insert_sleep(1 / FRAME_RATE)
        assert serializer is not None  # there is at least one time
        return serializer.as_html()
    finally:
        with quiet():
            server.stop()


def frame_times(subject: Subject) -> Iterable[float]:
    """Return the times of a recording's frames [s]."""
    end = float(subject.times[-1])
    count = min(round(end * FRAME_RATE) + 1, MOST_FRAMES)
    return [k / FRAME_RATE for k in range(count)]
