"""What Rerun is given of a running graph: MCAP files, read by a reader that is not ours. It is not installed itself."""

import io
import socket
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.viewing.live_view import LiveView, live_view
from pipeline.deployment.viewing.painting import PAINTED_TOPICS
from pipeline.deployment.viewing.rerun_bridge import main
from tests.deployment.machines import MIDDLE, bobcat
from tests.deployment.viewing.test_live_view import BEGIN_NS, FEW, STEP_NS, move, wait_until


def test_rerun_is_given_all_that_is_painted_while_the_graph_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    files: list[bytes] = []
    rerun = SimpleNamespace(
        init=lambda name, spawn: None, log_file_from_contents=lambda path, contents: files.append(contents)
    )
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    with live_view(bobcat(), MACHINE_DIRECTORY, FEW, port=0) as (view,):
        assert isinstance(view, LiveView)
        bridge = threading.Thread(target=main, args=(view._server.place.rpartition(":")[2],))
        bridge.start()
        wait_until(view, is_wanted=True)
        move(view, 120)
    bridge.join()
    given: dict[str, list[tuple[int, object]]] = {}
    for file in files:
        reader = make_reader(io.BytesIO(file), decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            given.setdefault(channel.topic, []).append((message.log_time, content))
    assert set(given) >= {*PAINTED_TOPICS, "/robot_description", "/tf", "/workspace"}
    shares = [content.data for _, content in given["/painted_share"]]
    assert len(shares) == 3 and 0 < shares[0] < shares[2] < 1
    times_ns, joints = zip(*given["/joints"], strict=True)
    steps = (np.array(times_ns) - BEGIN_NS) / STEP_NS
    np.testing.assert_allclose([j.position[0] for j in joints], MIDDLE[0] + 0.01 * steps)


def test_what_is_missing_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    monkeypatch.setitem(sys.modules, "rerun", SimpleNamespace())
    with pytest.raises(SystemExit, match=f"no graph at live_port={port} .*; start one"):
        main(port)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(SystemExit, match="pip install rerun-sdk"):
        main(port)
