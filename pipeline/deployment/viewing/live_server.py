"""A server of the Foxglove WebSocket protocol, v1, for live pictures in Foxglove, and of a page for browsers.

Protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md. It serves this computer only.
"""

import contextlib
import json
import queue
import socket
import struct
import threading
from collections.abc import Sequence
from http import HTTPStatus
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Self

from rosbags.typesys.store import Typestore
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

from pipeline.errors import InputError

HOST = "127.0.0.1"
PROTOCOL = Subprotocol("foxglove.websocket.v1")
MESSAGE_DATA = struct.Struct("<BIQ")  # opcode, subscription, time in ns; the message follows
MESSAGE_DATA_OPCODE = 1
HANDSHAKE_S = 1.0  # time for a handshake, and at the end for a viewer's close
QUEUE_LENGTH = 256  # queued messages for a slow viewer; further ones are dropped


class Channel(NamedTuple):
    """A topic and its ROS 2 type."""

    topic: str
    type_name: str


class _Viewer:
    """One connection: its subscribed channels and its queue."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.subscriptions: dict[int, int] = {}  # by channel
        self._waiting: queue.Queue[bytes | None] = queue.Queue(QUEUE_LENGTH)

    def offer(self, channel: int, time_ns: int, data: bytes) -> None:
        """Queue a message without waiting for the network."""
        if channel in self.subscriptions:
            header = MESSAGE_DATA.pack(MESSAGE_DATA_OPCODE, self.subscriptions[channel], time_ns)
            with contextlib.suppress(queue.Full):
                self._waiting.put_nowait(header + data)

    def send(self) -> None:
        """Send queued messages until the connection ends."""
        with contextlib.suppress(ConnectionClosed):
            while (frame := self._waiting.get()) is not None:
                self.connection.send(frame)

    def end(self) -> None:
        """Close the queue."""
        while True:
            try:
                return self._waiting.put_nowait(None)
            except queue.Full:
                with contextlib.suppress(queue.Empty):
                    self._waiting.get_nowait()

    def cut_off(self) -> None:
        """Shut down the socket; a regular close would wait for the sender."""
        with contextlib.suppress(OSError):  # it has ended meanwhile
            self.connection.socket.shutdown(socket.SHUT_RDWR)


class LiveServer:
    """Publishes messages to all connected viewers; a new viewer gets the newest message of each channel.

    Use it as a context manager: it serves from entering to leaving.
    """

    def __init__(self, port: int, store: Typestore, channels: Sequence[Channel], page: bytes = b"") -> None:
        """Binds the port.

        Args:
            port: port on this computer; 0 for any free port.
            store: typestore of the channels' types.
            channels: all channels.
            page: HTML, UTF-8, for whoever asks for a page.

        Raises:
            InputError: the port is taken.
        """
        self._store, self._page = store, page
        self._channels = {channel.topic: (number, channel) for number, channel in enumerate(channels)}
        self._lock = threading.Lock()
        self._viewers: set[_Viewer] = set()
        self._newest: dict[int, tuple[int, bytes]] = {}
        try:
            self._server = serve(
                self._serve,
                HOST,
                port,
                subprotocols=[PROTOCOL],
                process_request=self._answer_browser,
                compression=None,
                open_timeout=HANDSHAKE_S,
                close_timeout=HANDSHAKE_S,
            )
        except (OSError, OverflowError) as error:
            raise InputError(f"live_port={port}: {error}; name another port") from None
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def place(self) -> str:
        """Host and port, behind `ws://` for viewers and behind `http://` for browsers."""
        return f"{HOST}:{self._server.socket.getsockname()[1]}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        close_timer = threading.Timer(HANDSHAKE_S, self._cut_off)
        close_timer.start()
        self._server.shutdown()
        close_timer.cancel()
        self._thread.join()

    def _cut_off(self) -> None:
        with self._lock:
            for viewer in self._viewers:
                viewer.cut_off()

    def publish(self, topic: str, time_ns: int, message: "Msg") -> None:
        """Send a message of a channel to its subscribers."""
        number, channel = self._channels[topic]
        data = bytes(self._store.serialize_cdr(message, channel.type_name))
        with self._lock:
            self._newest[number] = time_ns, data
            for viewer in self._viewers:
                viewer.offer(number, time_ns, data)

    def _answer_browser(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, or None for a viewer."""
        if "Upgrade" in request.headers:
            return None
        if request.path != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, f"the page is http://{self.place}/\n")
        about = {"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(self._page))}
        return Response(HTTPStatus.OK, "OK", Headers(about), self._page)

    def _serve(self, connection: ServerConnection) -> None:
        viewer = _Viewer(connection)
        sender = threading.Thread(target=viewer.send, daemon=True)
        with self._lock:
            self._viewers.add(viewer)
        try:
            connection.send(
                json.dumps({"op": "serverInfo", "name": "hydraulic-arm-pipeline", "capabilities": []})
            )
            connection.send(json.dumps({"op": "advertise", "channels": self._advertised()}))
            sender.start()
            for text in connection:
                self._answer(viewer, text)
        except (ConnectionClosed, ValueError, KeyError, TypeError):
            pass  # the viewer is gone or uses another protocol
        finally:
            viewer.end()
            if sender.ident is not None:
                sender.join()
            with self._lock:
                self._viewers.discard(viewer)

    def _answer(self, viewer: _Viewer, text: str | bytes) -> None:
        request = json.loads(text)
        with self._lock:
            if request["op"] == "subscribe":
                for wanted in request["subscriptions"]:
                    channel = int(wanted["channelId"])
                    viewer.subscriptions[channel] = int(wanted["id"])
                    if channel in self._newest:
                        viewer.offer(channel, *self._newest[channel])
            elif request["op"] == "unsubscribe":
                ended = set(request["subscriptionIds"])
                viewer.subscriptions = {
                    channel: number for channel, number in viewer.subscriptions.items() if number not in ended
                }

    def _advertised(self) -> list[dict[str, object]]:
        return [
            {
                "id": number,
                "topic": channel.topic,
                "encoding": "cdr",
                "schemaName": channel.type_name,
                "schema": self._store.generate_msgdef(channel.type_name, ros_version=2)[0],
                "schemaEncoding": "ros2msg",
            }
            for number, channel in self._channels.values()
        ]
