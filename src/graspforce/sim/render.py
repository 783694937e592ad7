"""Stills and videos of a simulation, drawn from its log.

Every contact is drawn with its friction cone and the force in the physics: what a fingertip exerts
on the object, which is translucent, or the ground on a foot.

Drawing is offscreen, by EGL where ``MUJOCO_GL`` does not say otherwise.
"""

from __future__ import annotations

import copy
import errno
import importlib
import itertools
import math
import os
import platform
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._util.arrays import Array
from graspforce._util.atomic import atomic_write, check_output
from graspforce.contact import FPC, Contact
from graspforce.errors import InvalidInputError, MissingExtraError
from graspforce.sim.log import Log
from graspforce.sim.mujoco_import import mj, no_opengl_error
from graspforce.sim.trial import Trial

STILLS = (".png",)
VIDEOS = (".mp4", ".gif")

FRAME_RATE = 25.0  # of a video, which plays in real time [1/s]

Image = NDArray[np.uint8]

_CONE = (0.0, 0.45, 0.70, 0.28)
_FORCE = (0.84, 0.37, 0.0, 1.0)
_OBJECT_OPACITY = 0.45  # at most
_FACETS = 32


class Camera:
    """Draws moments of a simulation as images; close it, or use it in a ``with``.

    It looks through the model's camera "view"; without one, as MuJoCo's viewer would.

    Args:
        trial: what was simulated.
        log: what it gave.
        width: of the images [pixel].
        height: likewise.

    Raises:
        RenderError: there is no OpenGL to draw with.
    """

    def __init__(self, trial: Trial, log: Log, width: int = 640, height: int = 480) -> None:
        self._trial, self._log = trial, log
        self._model: Any = copy.copy(trial.model)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        if trial.ground is None:  # so that cones and forces inside the object are visible
            held = self._model.geom_bodyid == self._model.body(trial.body).id
            self._model.geom_rgba[held, 3] = np.minimum(
                self._model.geom_rgba[held, 3], _OBJECT_OPACITY
            )
        self._data = mj.MjData(self._model)
        self._gl, self._context = _open_gl(self._model)
        self._scene = mj.MjvScene(self._model, maxgeom=2000)
        self._options, self._view = mj.MjvOption(), mj.MjvCamera()
        mj.mjv_defaultFreeCamera(self._model, self._view)
        camera = mj.mj_name2id(self._model, mj.mjtObj.mjOBJ_CAMERA, "view")
        if camera >= 0:
            self._view.type, self._view.fixedcamid = mj.mjtCamera.mjCAMERA_FIXED, camera
        self._rectangle = mj.MjrRect(0, 0, width, height)
        # The largest force of most ticks is drawn half as long as the object is wide.
        largest = float(np.median(np.linalg.norm(log.force, axis=-1).max(axis=1))) or 1.0
        self._length = 0.5 * _size(trial) / largest

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the OpenGL context."""
        self._context.free()
        self._gl.free()

    def image(self, tick: int) -> Image:
        """Return the picture of a tick, shape (height, width, 3)."""
        model, data = self._model, self._data
        data.qpos[:] = self._log.qpos[tick]
        mj.mj_forward(model, data)
        categories = mj.mjtCatBit.mjCAT_ALL.value
        mj.mjv_updateScene(model, data, self._options, None, self._view, categories, self._scene)
        for finger in np.flatnonzero(self._log.engagement[tick] > 0):
            self._draw_contact(tick, int(finger))
        pixels = np.empty((self._rectangle.height, self._rectangle.width, 3), np.uint8)
        self._gl.make_current()
        mj.mjr_render(self._rectangle, self._scene, self._context)
        mj.mjr_readPixels(pixels, None, self._rectangle, self._context)
        return np.flipud(pixels)

    def _draw_contact(self, tick: int, finger: int) -> None:
        point, normal = self._log.point[tick, finger], self._log.normal[tick, finger]
        force = self._log.force[tick, finger]
        length = 0.3 * _size(self._trial)
        angles = np.linspace(0, 2 * math.pi, _FACETS + 1)
        circle = _friction(self._trial) * np.array([np.cos(angles), np.sin(angles)])
        frame = Contact(point, normal, FPC()).frame
        rim = length * (frame @ np.vstack((np.ones(_FACETS + 1), circle))).T
        for one, other in pairwise(rim):
            self._triangle(point, one, other)
        if np.linalg.norm(force) * self._length > 1e-3 * length:
            arrow = self._new_geom(mj.mjtGeom.mjGEOM_ARROW, _FORCE)
            arrow.emission = 0.4  # visible in the shade, too
            # MuJoCo draws an arrow half as long as it is told.
            end = point + 2 * self._length * force
            mj.mjv_connector(arrow, mj.mjtGeom.mjGEOM_ARROW, 0.06 * length, point, end)

    def _triangle(self, corner: Array, one: Array, other: Array) -> None:
        geom = self._new_geom(mj.mjtGeom.mjGEOM_TRIANGLE, _CONE)
        geom.pos = corner
        geom.mat = np.column_stack((one, other, np.cross(one, other)))
        geom.size = np.ones(3)

    def _new_geom(self, kind: Any, rgba: tuple[float, float, float, float]) -> Any:
        geom = self._scene.geoms[self._scene.ngeom]
        self._scene.ngeom += 1
        mj.mjv_initGeom(
            geom, kind, np.ones(3), np.zeros(3), np.eye(3).ravel(), np.array(rgba, np.float32)
        )
        return geom


def picture(trial: Trial, log: Log, t: float) -> Image:
    """Return a picture of the time t [s], shape (960, 1280, 3).

    Raises:
        InvalidInputError: a time that was not simulated.
        RenderError: there is no OpenGL to draw with.
    """
    tick = round(t * trial.rate)
    if not 0 <= tick < len(log.t):
        raise InvalidInputError(f"t: got {t} s, expected 0 to {log.t[-1]:g} s")
    with Camera(trial, log, 1280, 960) as camera:
        return camera.image(tick)


def save_still(trial: Trial, log: Log, path: str | Path, t: float) -> None:
    """Write a picture of the time t [s] to a .png of 1280 × 960 pixels.

    Raises:
        InvalidInputError: another ending, a place that ``files.check_output`` refuses, or a time
            that was not simulated.
        OSError: the file cannot be written; what it held before is still there.
        RenderError: there is no OpenGL to draw with.
        MissingExtraError: imageio is not installed.
    """
    check_output(path, STILLS)
    imageio = _imageio()
    image = picture(trial, log, t)
    with atomic_write(path) as temporary:
        temporary.write_bytes(imageio.imwrite("<bytes>", image, extension=".png"))


def save_video(
    trial: Trial,
    log: Log,
    path: str | Path,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a video to a .mp4 or an animated .gif.

    Args:
        trial: what was simulated.
        log: what it gave.
        path: the file to write.
        progress: called after every frame with how many are done and how many there are.

    Raises:
        InvalidInputError: another ending, or a place that ``files.check_output`` refuses.
        OSError: the file cannot be written; what it held before is still there.
        RenderError: there is no OpenGL to draw with.
        MissingExtraError: imageio or imageio-ffmpeg is not installed.
    """
    check_video_file(path)
    step = trial.rate / FRAME_RATE
    ticks = [round(k * step) for k in range(int((len(log.t) - 1) / step) + 1)]

    def images(camera: Camera) -> Iterator[Image]:
        for index, tick in enumerate(ticks):
            yield camera.image(tick)
            if progress is not None:
                progress(index + 1, len(ticks))

    write = _write_gif if Path(path).suffix.lower() == ".gif" else _write_mp4
    with Camera(trial, log) as camera, atomic_write(path) as temporary:
        write(temporary, images(camera))


def check_video_file(path: str | Path) -> None:
    """Make sure, before any long work, that a video can be written to ``path``.

    Raises:
        InvalidInputError: another ending than .mp4 or .gif, or a place that
            ``files.check_output`` refuses.
        MissingExtraError: imageio or imageio-ffmpeg is not installed.
    """
    check_output(path, VIDEOS)
    _imageio() if Path(path).suffix.lower() == ".gif" else _ffmpeg()


def _write_gif(path: Path, images: Iterator[Image]) -> None:
    path.write_bytes(
        _imageio().imwrite(
            "<bytes>", list(images), extension=".gif", duration=1000 / FRAME_RATE, loop=0
        )
    )


def _write_mp4(path: Path, images: Iterator[Image]) -> None:
    """Write a video with ffmpeg; imageio's writer does not report failures such as a full disk.

    Raises:
        OSError: ffmpeg failed; the text is its first line of stderr.
    """
    first = next(images)
    height, width, _ = first.shape
    command = [
        _ffmpeg(), "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
        "-s", f"{width}x{height}", "-r", f"{FRAME_RATE:g}", "-i", "pipe:",
        "-c:v", "libx264", "-crf", "10", "-pix_fmt", "yuv420p", f"file:{path}",
    ]  # fmt: skip
    with (
        tempfile.TemporaryFile() as stderr,
        subprocess.Popen(command, stdin=subprocess.PIPE, stderr=stderr) as process,
    ):
        pipe: Any = process.stdin
        try:
            for image in itertools.chain([first], images):
                pipe.write(image.tobytes())
            pipe.close()
        except BrokenPipeError:
            pass  # ffmpeg has ended; its stderr is read below
        except BaseException:
            process.kill()
            raise
        if process.wait() != 0:
            stderr.seek(0)
            text = stderr.read().decode(errors="replace").strip() or "no output on stderr"
            reason = re.sub(r"^\[.*?\] ", "", text.splitlines()[0])
            raise OSError(errno.EIO, f"ffmpeg failed: {reason}")


def _size(trial: Trial) -> float:
    """Return the size of what is carried, as the distance between opposite contacts [m]."""
    if not trial.grips:
        model = trial.model
        return float(model.geom_rbound[model.geom_bodyid == model.body(trial.body).id].max())
    points = np.array([grip.point for grip in trial.grips])
    return float(np.linalg.norm(points[:, None] - points, axis=-1).max())


def _friction(trial: Trial) -> float:
    """Return the coefficient whose cones are drawn: the controller's, or that of the object."""
    if trial.fingers or trial.mu is not None:
        return trial.assumed_mu
    model = trial.model
    return float(model.geom_friction[model.geom_bodyid == model.body(trial.body).id, 0].max())


def _open_gl(model: Any) -> tuple[Any, Any]:
    """Return an OpenGL context and MuJoCo's rendering context in it."""
    size = model.vis.global_
    wanted = os.environ.get("MUJOCO_GL", "").lower() or (
        "egl" if platform.system() == "Linux" else ""
    )
    try:
        module = importlib.import_module(
            f"mujoco.{wanted}" if wanted in ("egl", "osmesa", "glfw") else "mujoco.gl_context"
        )
        gl: Any = module.GLContext(size.offwidth, size.offheight)
        gl.make_current()
        context: Any = mj.MjrContext(model, mj.mjtFontScale.mjFONTSCALE_100.value)
    except Exception as error:  # the exceptions of a missing driver differ by platform
        raise no_opengl_error(wanted, error) from error
    mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    return gl, context


def _imageio() -> Any:
    try:
        return importlib.import_module("imageio.v3")
    except ImportError as error:
        raise MissingExtraError("pictures and videos", "imageio", "sim") from error


def _ffmpeg() -> str:
    try:
        return importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except ImportError as error:
        raise MissingExtraError("videos in MP4", "imageio-ffmpeg", "sim") from error
