"""A running graph in Rerun: `python -m pipeline.deployment.viewing.rerun_bridge PORT` beside one with `live_port=PORT`.

Rerun is no client of the live server, but its SDK reads MCAP from memory: twice a second it is given what the server
has sent. The SDK, `rerun-sdk`, is no part of this environment.
"""

import io
import json
import sys
import time
from collections.abc import Iterator
from typing import Any

from mcap.writer import Writer
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from pipeline.deployment.viewing.live_server import HOST, MESSAGE_DATA, PROTOCOL

PERIOD_S = 0.5


def mcap_files(connection: ClientConnection) -> Iterator[bytes]:
    """All that a live server sends, as MCAP files one after the other, until it ends."""
    channels: list[dict[str, Any]] = []
    while not channels:
        channels = json.loads(connection.recv()).get("channels", [])
    wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
    connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    by_number = {channel["id"]: channel for channel in channels}
    is_open = True
    while is_open:
        frames: list[bytes] = []
        end_s = time.monotonic() + PERIOD_S
        try:
            while (left_s := end_s - time.monotonic()) > 0:
                frames.append(connection.recv(timeout=left_s, decode=False))
        except TimeoutError:
            pass
        except ConnectionClosed:
            is_open = False
        if frames:
            yield _mcap(frames, by_number)


def _mcap(frames: list[bytes], channels: dict[int, dict[str, Any]]) -> bytes:
    file = io.BytesIO()
    writer = Writer(file)
    writer.start(profile="ros2")
    numbers: dict[int, int] = {}
    for frame in frames:
        _, number, time_ns = MESSAGE_DATA.unpack_from(frame)
        if number not in numbers:
            channel = channels[number]
            schema = writer.register_schema(
                channel["schemaName"], channel["schemaEncoding"], channel["schema"].encode()
            )
            numbers[number] = writer.register_channel(channel["topic"], channel["encoding"], schema)
        writer.add_message(numbers[number], time_ns, frame[MESSAGE_DATA.size :], time_ns)
    writer.finish()
    return file.getvalue()


def main(port: str) -> None:
    """Show the graph in Rerun's viewer, which is opened where none is, until the graph ends."""
    try:
        import rerun  # type: ignore[import-not-found]

        connection = connect(f"ws://{HOST}:{port}", subprotocols=[PROTOCOL], compression=None, max_size=None)
    except ImportError:
        sys.exit("rerun_bridge: no module rerun; `uv pip install rerun-sdk` puts it into this environment")
    except OSError as error:
        sys.exit(f"rerun_bridge: no graph at live_port={port} ({error}); start one first")
    rerun.init("hydraulic_arm", spawn=True)
    with connection:
        for contents in mcap_files(connection):
            rerun.log_file_from_contents("live.mcap", contents)


if __name__ == "__main__":
    main(*sys.argv[1:])
