"""``graspforce view``: a live 3-D page of a grasp."""

from __future__ import annotations

import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from graspforce.cli.terminal import show, tell
from graspforce.errors import GraspForceError, InvalidInputError

if TYPE_CHECKING:
    from graspforce.viewer import Begun, Look, Viewer

EXAMPLES = (
    "graspforce view regrasp --open",
    "graspforce view hold",
    "graspforce view examples/several_grasps.json",
    "graspforce view hand/leap",
    "graspforce view hold --log hold.npz",
    "graspforce view --model scene.xml --object cube",
    "graspforce view --hand hand.xml --tip thumb --tip index",
    "graspforce view static --set alpha=100 --set load=1",
)


def view(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME | FILE]",
            help="A scenario (static, dynamic, regrasp), a simulated scene (hold, circle, "
            "sim/regrasp, …), a hand that holds something (hand/leap, …), or a file of grasps.  "
            "[default: static]",
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="Of a simulated scene, the .npz that graspforce simulate --log wrote."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="A scene of your own in physics: an MJCF file with hand and object."),
    ] = None,
    body: Annotated[
        str | None, typer.Option("--object", metavar="BODY", help="Its body that is held.")
    ] = None,
    hand: Annotated[
        str | None,
        typer.Option(help="In place of it, a hand: MJCF or URDF; contacts are picked by clicks."),
    ] = None,
    tip: Annotated[
        list[str] | None,
        typer.Option(
            help="A fingertip's link of that hand; may be given several times.  [default: the "
            "last link of every chain that motors move]"
        ),
    ] = None,
    tau_max: Annotated[
        float | None, typer.Option(help="Limit of every motor of that hand [N·m, N].")
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KNOB=VALUE", help="Where a knob stands at first."),
    ] = None,
    port: Annotated[int, typer.Option(help="Where the page is; 0 takes a free port.")] = 8080,
    host: Annotated[
        str,
        typer.Option(help="The interface; any but this machine's own lets others use the page."),
    ] = "127.0.0.1",
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the page in the browser.")
    ] = False,
) -> None:
    """Show a grasp as a live 3-D page, whose forces answer while one turns knobs.

    The page has the forces with their newtons, how much of friction and torques they use, why a
    load is not held and what would help. It is served until Ctrl-C. The browser has to
    have WebGL. Needs the extra 'view': in a checkout, pip install '.[view]'.
    """
    from graspforce import viewer

    sources = {"NAME": name, "--hand": hand, "--model": model}
    given = [f"{option} {value}" for option, value in sources.items() if value is not None]
    if len(given) > 1:
        raise InvalidInputError(f"{given[0]}: got {given[1]} beside it, expected one of them")
    if hand is None and (tip or tau_max is not None):
        raise InvalidInputError("--tip, --tau-max: expected together with --hand")
    if (model is None) != (body is None):
        raise InvalidInputError("--model, --object: got one of them, expected both")
    if hand is not None:
        if log is not None:
            raise InvalidInputError("--log: expected with a simulated scene, got --hand")
        begun = viewer.Begun(viewer.open_hand(hand, tip or (), tau_max))
    elif model is not None and body is not None:
        begun = viewer.begin_scene(model, body, log)
    else:
        begun = viewer.begin_subject(name or "static", log)
    settings = dict(map(_setting, changes or ()))
    shown, failed = begun.shown, False
    page = viewer.Viewer(shown, shown.knobs.from_texts(settings), host, port)
    try:
        show(f"{shown.title}: {shown.summary}", f"{page.url}  (Ctrl-C ends it)", wrap=False)
        if open_page:
            webbrowser.open(page.url)
        if isinstance(shown, viewer.Look):
            # Here and not in a thread of its own: Ctrl-C ends it at once.
            failed = not _finish(page, shown, begun, settings)
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        page.stop()
    if failed:
        raise typer.Exit(2)


def _finish(page: Viewer, look: Look, begun: Begun, settings: dict[str, str]) -> bool:
    """Let a page turn to its subject when that is made; return whether it could be."""
    try:
        subject = begun.finished()
        page.turn_to(subject, subject.knobs.from_texts(settings))
    except GraspForceError as error:
        page.turn_to(look.failing(str(error)))
        tell(str(error))
        return False
    return True


def _setting(text: str) -> tuple[str, str]:
    knob, found, value = text.partition("=")
    if not (knob and found):
        raise InvalidInputError(f"--set: got {text!r}, expected KNOB=VALUE")
    return knob, value
