"""``graspforce batch``: the forces of a data set of grasps."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graspforce.cli.terminal import progress_columns, show
from graspforce.errors import InvalidInputError

if TYPE_CHECKING:
    from graspforce.datasets import Counts

EXAMPLES = (
    "graspforce batch grasps.parquet forces",
    "graspforce batch grasps/ forces --set mu=0.5 --set c_max=20 --gravity sphere",
    "graspforce batch grasps.npz forces --slip-reserve 0.3 --key object --key scale",
    "graspforce batch /shared/grasps /shared/forces --engine ray --ray-address auto",
)


def batch(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE",
            help="Grasps: .parquet, .npz, .h5 or .jsonl, or a folder; see docs/datasets.md.",
        ),
    ],
    target: Annotated[
        Path, typer.Argument(metavar="TARGET", help="Folder for the forces, new or begun before.")
    ],
    engine: Annotated[
        str, typer.Option(help="local: the cores of this machine; ray: a Ray cluster.")
    ] = "local",
    ray_address: Annotated[
        str | None, typer.Option(help="Cluster to join; by default Ray starts here.")
    ] = None,
    values: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A column's value for all rows, as JSON."),
    ] = None,
    keys: Annotated[
        list[str] | None,
        typer.Option(
            "--key", help="Column to carry through; by default all that the format does not know."
        ),
    ] = None,
    gravity: Annotated[
        str | None,
        typer.Option(
            help="sphere or sphere20: solve each grasp for 6 or 20 directions of gravity."
        ),
    ] = None,
    largest_normal: Annotated[
        float | None, typer.Option(help="Wish: no finger pushes harder [N].")
    ] = None,
    times_least: Annotated[
        float | None,
        typer.Option(help="Wish: the largest normal force as a multiple of the least possible."),
    ] = None,
    slip_reserve: Annotated[
        float | None, typer.Option(help="Wish: the share by which friction may be lower.")
    ] = None,
    torque_reserve: Annotated[
        float | None, typer.Option(help="Wish: the share of each joint's range that stays free.")
    ] = None,
    sensitivities: Annotated[
        list[str] | None,
        typer.Option("--sensitivity", help="Field by which to write derivatives of c, as f."),
    ] = None,
    hand: Annotated[
        str | None, typer.Option(help="MJCF or URDF file of the hand whose joint angles are q.")
    ] = None,
    fingertips: Annotated[
        list[str] | None,
        typer.Option("--fingertip", help="The hand's link that makes a contact, one a contact."),
    ] = None,
    tau_max: Annotated[
        float | None, typer.Option(help="Torque limit of the hand's motors [N·m].")
    ] = None,
    layout: Annotated[
        str | None, typer.Option(help="Published layout of .npy files: dexgraspnet or bodex.")
    ] = None,
    meshes: Annotated[
        str | None,
        typer.Option(help="Folder of the objects' meshes, where contacts are not stored."),
    ] = None,
    contact_distance: Annotated[
        float, typer.Option(help="How far a link may be from the mesh and touch it [m].")
    ] = 0.005,
    tol: Annotated[float, typer.Option(help="Certified bound on decrement²/2 at the end.")] = 1e-9,
    rows_per_part: Annotated[
        int, typer.Option(help="Rows of the source in each file of the target.")
    ] = 16384,
    threads: Annotated[
        int | None, typer.Option(help="Threads of the local engine; by default all cores.")
    ] = None,
) -> None:
    """Solve the data set SOURCE into Parquet files in TARGET.

    Killed at any moment and started again, it goes on where it was. Rows that make no problem go to
    TARGET/rejects with a reason and stop nothing; infeasible grasps are rows like others. Exit
    codes: 0 all rows are done; 2 an argument, a column or TARGET is wrong, nothing was done; 3 it
    ended early (full disk, unreadable file, lost worker), and the same command goes on.
    """
    from graspforce._engine.settings import Settings
    from graspforce.datasets import solve_dataset

    with _progress() as progress:
        summary = solve_dataset(
            source, target, engine, keys=keys, gravity=gravity, largest_normal=largest_normal,
            times_least=times_least, slip_reserve=slip_reserve, torque_reserve=torque_reserve,
            sensitivities=sensitivities or (), hand=hand, fingertips=fingertips, tau_max=tau_max,
            layout=layout, meshes=meshes, contact_distance=contact_distance,
            settings=Settings(tol=tol), rows_per_part=rows_per_part, threads=threads,
            ray_address=ray_address, progress=progress, **_values(values or []),
        )  # fmt: skip
    show(*str(summary).splitlines())


def _values(given: list[str]) -> dict[str, Any]:
    """Return what ``--set`` says; a value that is no JSON is a text."""
    values: dict[str, Any] = {}
    for each in given:
        name, equals, text = each.partition("=")
        if not equals:
            raise InvalidInputError(f"--set: got {each!r}, expected NAME=VALUE")
        try:
            values[name] = json.loads(text)
        except ValueError:
            values[name] = text
    return values


@contextmanager
def _progress() -> Generator[Callable[[Counts, int], None]]:
    """Show rows, rows a second, time left and outcomes on stderr, if that is a terminal."""
    with progress_columns("rows") as update:

        def progress(counts: Counts, total: int) -> None:
            infeasible = counts.statuses["INFEASIBLE"]
            told = (
                f"{counts.solved:,} solved, {infeasible:,} infeasible, {counts.rejected:,} rejected"
            )
            update(counts.rows, total, told)

        yield progress
