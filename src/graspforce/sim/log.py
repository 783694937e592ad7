"""The log of a closed-loop simulation, a row a tick, and its files."""

from __future__ import annotations

import csv
import dataclasses
import enum
import importlib
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspforce._engine.outcome import Status
from graspforce._util.arrays import Array
from graspforce._util.atomic import atomic_write, check_output
from graspforce._util.npz import write_npz
from graspforce.errors import InvalidInputError, MissingExtraError

SUFFIXES = (".npz", ".parquet", ".csv")


# A tip that moved farther than this on the object has slipped; below it is contact creep [m].
SLIP_TOLERANCE = 1e-3


class Ending(enum.Enum):
    """How a simulation came to its end."""

    COMPLETED = "held"
    DROPPED = "dropped"
    DIVERGED = "diverged"


@dataclass(slots=True, eq=False)
class Log:
    """T control ticks of a simulation, in world axes; preallocated, then trimmed.

    Attributes:
        t: times, shape (T,) [s].
        qpos: the model's joint positions, shape (T, nq) [rad, m].
        position: of the object's centre of mass, shape (T, 3) [m].
        quaternion: of the object, wxyz, shape (T, 4).
        target_position: shape (T, 3) [m].
        position_error: distance of the centre of mass from its target, shape (T,) [m].
        rotation_error: angle between object and target, shape (T,) [rad].
        yaw: the object's angle about z, without jumps, shape (T,) [rad].
        f: wrench asked for, about the centre of mass, shape (T, 6) [N, N·m].
        engagement: of every contact, shape (T, n).
        c: contact forces asked for, in the contact frames, shape (T, 3 n) [N].
        force: contact forces that the physics gave at the end of the tick, world axes, shape
            (T, n, 3) [N]; 0 when off.
        normal_force: their normal components, shape (T, n) [N].
        point: contact points, shape (T, n, 3) [m].
        normal: contact normals into the object, shape (T, n, 3).
        clearance: distance of every fingertip to the object, shape (T, n) [m]; 0 when touching.
        tau: joint torques asked for, shape (T, n_joints) [N·m].
        tau_max: the torque limits, shape (n_joints,) [N·m].
        slip: distance that every tip has slipped since contact was made, shape (T, n) [m].
        newton_steps: of the force problem (iterations of the minimum-norm SOCP), shape (T,).
        status: values of :class:`graspforce.Status`, shape (T,).
        kept: whether the tick found no forces inside the limits, not even for the nearest wrench,
            and its torques are those of the last tick that had some, shape (T,).
        without_slot: how many contacts came late and found no room, shape (T,): not counted on.
        ending: how it ended.
        message: why, with the tick, when it did not complete.
    """

    t: Array
    qpos: Array
    position: Array
    quaternion: Array
    target_position: Array
    position_error: Array
    rotation_error: Array
    yaw: Array
    f: Array
    engagement: Array
    c: Array
    force: Array
    normal_force: Array
    point: Array
    normal: Array
    clearance: Array
    tau: Array
    tau_max: Array
    slip: Array
    newton_steps: NDArray[np.int64]
    status: NDArray[np.int64]
    kept: NDArray[np.bool_]
    without_slot: NDArray[np.int64]
    ending: Ending = Ending.COMPLETED
    message: str = ""

    @classmethod
    def blank(cls, ticks: int, nq: int, n: int, tau_max: Array) -> Log:
        """Return a log of zeros for T ticks of nq joint positions and n contacts.

        What the force problems gave (c, newton_steps, status) is empty until the loop sets it.

        Raises:
            InvalidInputError: more ticks than the memory holds.
        """

        def zeros(*shape: int) -> Array:
            try:
                return np.zeros((ticks, *shape))
            except MemoryError:
                raise InvalidInputError(
                    f"duration: got {ticks} ticks, expected a log of them to fit into memory"
                ) from None

        return cls(
            t=zeros(), qpos=zeros(nq), position=zeros(3), quaternion=zeros(4),
            target_position=zeros(3), position_error=zeros(), rotation_error=zeros(), yaw=zeros(),
            f=zeros(6), engagement=zeros(n), force=zeros(n, 3), normal_force=zeros(n),
            point=zeros(n, 3), normal=zeros(n, 3), clearance=zeros(n), tau=zeros(len(tau_max)),
            tau_max=tau_max, slip=zeros(n), c=np.empty((0, 3 * n)),
            newton_steps=np.empty(0, np.int64), status=np.empty(0, np.int64),
            kept=np.zeros(ticks, dtype=bool), without_slot=np.zeros(ticks, np.int64),
        )  # fmt: skip

    def ended(self, ticks: int, ending: Ending, message: str) -> Log:
        """Return the log of the first ``ticks`` ticks, with how it came to its end."""
        kept = {name: getattr(self, name)[:ticks] for name in _PER_TICK}
        return dataclasses.replace(self, **kept, ending=ending, message=message)

    # ---- in short --------------------------------------------------------------------------

    @property
    def held(self) -> bool:
        """Whether the object was held to the end."""
        return self.ending is Ending.COMPLETED

    @property
    def verdict(self) -> str:
        """How it ended, in words: "held, but slipped" where a tip slipped by more than 1 mm."""
        slipped = self.held and float(self.slip.max()) > SLIP_TOLERANCE
        return "held, but slipped" if slipped else self.ending.value

    @property
    def torque_use(self) -> float:
        """The largest share of its limit that any joint torque took; above 1 exceeds it."""
        return float((np.abs(self.tau) / self.tau_max).max())

    @property
    def unsolved(self) -> int:
        """The number of ticks whose force problem had no answer."""
        return int((self.status != Status.SOLVED).sum())

    @property
    def regrasps(self) -> int:
        """How often a finger came back to the object after it had been more than 1 mm away."""
        away = self.clearance > 1e-3
        return int((away[:-1] & ~away[1:]).sum())

    # ---- files -----------------------------------------------------------------------------

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a log that :meth:`save` wrote as .npz.

        Raises:
            InvalidInputError: no such file, or none of a log.
        """
        path = Path(path)
        said = f"log: got {path}, expected the .npz of a log as graspforce simulate --log writes it"
        if path.suffix.lower() != ".npz":
            raise InvalidInputError(f"{said}; another ending does not have all of it")
        try:
            with np.load(path, allow_pickle=False) as data:
                arrays = {name: data[name] for name in (*_PER_TICK, "tau_max")}
                ending, message = Ending[str(data["ending"])], str(data["message"])
        except OSError as error:
            raise InvalidInputError(f"{said} ({error.strerror or error})") from error
        except KeyError as error:
            raise InvalidInputError(f"{said}; it has no {error.args[0]}") from error
        except (ValueError, zipfile.BadZipFile) as error:
            raise InvalidInputError(f"{said}: {error}") from error
        return cls(**arrays, ending=ending, message=message)

    def table(self) -> dict[str, Array]:
        """Return every column, shape (T,), by its name: ``tau_3``, ``point_2_x``, and so on."""
        columns: dict[str, Array] = {}
        for name in _PER_TICK:
            values: Any = getattr(self, name)
            if values.dtype == bool:
                values = values.astype(np.int64)
            for index in np.ndindex(values.shape[1:]):
                ending = [str(k + 1) for k in index]
                if name in _IN_AXES:
                    ending[-1] = "xyz"[index[-1]]
                columns["_".join((name, *ending))] = values[(slice(None), *index)]
        return columns

    def save(self, path: str | Path) -> None:
        """Write every tick to a .npz (arrays as here), .parquet or .csv (a column a number).

        Raises:
            InvalidInputError: another ending, or a place that ``files.check_output`` refuses.
            MissingExtraError: a .parquet without pyarrow.
            OSError: the file cannot be written; what it held before is still there.
        """
        path = Path(path)
        check_log_file(path)
        suffix = path.suffix.lower()
        with atomic_write(path) as temporary:
            if suffix == ".npz":
                arrays = {name: getattr(self, name) for name in (*_PER_TICK, "tau_max")}
                texts: dict[str, Any] = {"ending": self.ending.name, "message": self.message}
                write_npz(temporary, arrays | texts)
            elif suffix == ".parquet":
                arrow, parquet = _pyarrow()
                about = {"ending": self.ending.name, "message": self.message}
                table = arrow.table(self.table()).replace_schema_metadata(about)
                parquet.write_table(table, temporary)
            else:
                columns = self.table()
                with temporary.open("w", newline="", encoding="utf-8") as file:
                    writer = csv.writer(file)
                    writer.writerow(columns)
                    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
                    writer.writerows(rows)

    def __repr__(self) -> str:
        return (
            f"Log({len(self.t)} ticks, {self.ending.value}{self.message and f': {self.message}'})"
        )


_PER_TICK = tuple(
    each.name
    for each in dataclasses.fields(Log)
    if each.name not in ("tau_max", "ending", "message")
)
_IN_AXES = ("position", "target_position", "force", "point", "normal")


def check_log_file(path: Path) -> None:
    """Make sure that a log can be written to ``path``.

    Raises:
        InvalidInputError: another ending, or a place that ``files.check_output`` refuses.
        MissingExtraError: a .parquet without pyarrow.
    """
    check_output(path, SUFFIXES)
    if path.suffix.lower() == ".parquet":
        _pyarrow()


def _pyarrow() -> tuple[Any, Any]:
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise MissingExtraError("Parquet", "pyarrow", "sim") from error
