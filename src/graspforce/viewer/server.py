"""The server of the pages: one address, a session a client, an end on Ctrl-C."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import socket
import warnings
from typing import Any
from urllib.parse import quote

from viser import ClientHandle, ViserServer

from graspforce.errors import InvalidInputError, warn
from graspforce.viewer import words
from graspforce.viewer.knobs import Knobs
from graspforce.viewer.moment import Look, Subject
from graspforce.viewer.panel import dress_panel
from graspforce.viewer.scene import Scene, aim, dress, quiet
from graspforce.viewer.session import Session

# Each has a thread and a scene of its own: more than these would all be slow.
MOST_CLIENTS = 8
DEFAULT_PORT = 8080
# On pages narrower than this, as on a phone, viser has the panel as a sheet from below; the share
# of the height that it covers.
_NARROW, _SHEET = 576, 0.6


class Viewer:
    """Pages about a subject, served until :meth:`stop`.

    Args:
        subject: what they are about, or what they show until :meth:`turn_to` tells them.
        knobs: where the knobs stand when a page opens.
        host: the interface on which to listen.
        port: the port; 0 takes a free one.

    Warns:
        GraspForceWarning: a host by which others reach the page.

    Raises:
        InvalidInputError: a host that is not this machine's, a port that is in use or out of range.

    Attributes:
        sessions: of the pages that are open, by the client's number.
    """

    def __init__(
        self,
        subject: Subject | Look,
        knobs: Knobs | None = None,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
    ) -> None:
        if not _check_free(host, port):
            warn(f"host: whoever reaches this machine by {host} can use the page; it asks nobody")
        self._clients: dict[int, ClientHandle] = {}
        self.sessions: dict[int, Session] = {}
        # A page that closes while its thread draws is nothing to tell of.
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
        with quiet():
            self._server = ViserServer(host=host, port=port, verbose=False)
        self._host = host
        dress(self._server.scene)
        self._take(subject, knobs)
        self._server.on_client_connect(self._open)
        self._server.on_client_disconnect(self._close)

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self._address}/"

    @property
    def _address(self) -> str:
        host = "127.0.0.1" if self._host in ("", "0.0.0.0") else self._host
        return f"{f'[{host}]' if ':' in host else host}:{self._server.get_port()}"

    def link(self, knobs: Knobs) -> str:
        """Return a link to the page with the knobs where they stand."""
        query = knobs.to_query(self._knobs)
        # viser's page passes nothing of its own query on but the address of the server.
        return f"{self.url}?websocket={quote(f'ws://{self._address}/?{query}', safe='')}"

    def turn_to(self, subject: Subject | Look, knobs: Knobs | None = None) -> None:
        """Let pages that show a look turn to its subject, or to another look.

        Args:
            subject: what they are about from now on.
            knobs: where their knobs stand.
        """

        async def turn() -> None:
            self._take(subject, knobs)
            for client in tuple(self._clients.values()):
                client.gui.reset()
                client.scene.reset()
                self._show(client)

        asyncio.run_coroutine_threadsafe(turn(), self._server.get_event_loop()).result()

    def stop(self) -> None:
        """Close all pages and free the port."""
        sessions = list(self.sessions.values())
        for session in sessions:
            session.close()
        for session in sessions:
            session.join()
        with quiet():
            self._server.stop()

    # In the server's event loop.

    async def _open(self, client: ClientHandle) -> None:
        if len(self._clients) >= MOST_CLIENTS:
            client.gui.add_markdown(
                f"**{MOST_CLIENTS} pages are open already**, which is as many as this server "
                "shows. Close one and reload this page."
            )
            return
        self._clients[client.client_id] = client
        width, height = client.camera.image_width, client.camera.image_height
        if width < _NARROW:
            aim(client.camera, self._subject, _SHEET, width / height)
        self._show(client)

    def _take(self, subject: Subject | Look, knobs: Knobs | None) -> None:
        self._subject = subject
        self._knobs = subject.knobs if knobs is None else knobs
        aim(self._server.initial_camera, subject)

    def _show(self, client: ClientHandle) -> None:
        """Show the subject to a client whose page is empty."""
        subject, knobs = self._subject, self._knobs
        if isinstance(subject, Look):
            dress_panel(client.gui, subject.title)
            client.gui.add_html(words.look(subject))
            Scene(client.scene, subject).show(subject.bodies, subject.moment, None)
            return
        try:
            knobs = knobs.from_query(self._query(client))
        except InvalidInputError as error:
            client.add_notification("This link", str(error), color="red")
        self.sessions[client.client_id] = Session(client, subject, knobs, self.link)

    async def _close(self, client: ClientHandle) -> None:
        self._clients.pop(client.client_id, None)
        session = self.sessions.pop(client.client_id, None)
        if session is not None:
            session.close()

    def _query(self, client: ClientHandle) -> str:
        """Return the query of the address to which a client has connected."""
        connections: Any = self._server._websock_server._live_connections  # pyright: ignore[reportPrivateUsage]
        path: str = connections[client.client_id].request.path
        return path.partition("?")[2]


def _check_free(host: str, port: int) -> bool:
    """Return whether the host is this machine's own interface.

    Raises:
        InvalidInputError: the port cannot be had; viser would take the next one.
    """
    if not 0 <= port <= 65535:
        raise InvalidInputError(f"port: got {port}, expected 0 to 65535")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, _, _, _, address = found[0]
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except socket.gaierror as error:
        raise InvalidInputError(
            f"host: got {host!r}, expected an address of this machine ({error.strerror})"
        ) from error
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            raise InvalidInputError(
                f"host: got {host!r}, expected an address of this machine"
            ) from error
        raise InvalidInputError(
            f"port: got {port} on {host}, expected a free one ({error.strerror}); --port 0 takes "
            "any"
        ) from error
    return ipaddress.ip_address(address[0]).is_loopback
