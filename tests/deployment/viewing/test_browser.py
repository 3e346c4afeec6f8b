"""The live view's page in a real headless Chromium, asked by the DevTools protocol for what it shows."""

import base64
import contextlib
import http.client
import json
import re
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import nanoseconds
from pipeline.deployment.messages import JointState, Topic
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.viewing.live_view import LiveView, live_view, page_of
from tests.deployment.machines import MIDDLE, arm, bobcat

FEW = CoverageConfig(cell_m=0.5, pitch_bin_rad=0.5, pitch_max_rad=1.0, samples_per_cell=1)
PATIENCE_S = 120.0  # on a busy computer
BEGIN_NS = 1_775_000_000_000_000_000
STEP_NS = nanoseconds(0.05)
PIXELS_NEAR = """(name, point, colour) => {
  const canvas = document.getElementById(name);
  const [x, y] = scaleOf(VIEWS[name], canvas)(point);
  const { data } = canvas.getContext("2d").getImageData(x - 4, y - 4, 9, 9);
  let found = 0;
  for (let i = 0; i < data.length; i += 4)
    if (data[i + 3] && colour.every((value, channel) => Math.abs(data[i + channel] - value) < 40)) found++;
  return found;
}"""


class Browser:
    """A tab of Chromium."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._numbers = count()

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self._connection.recv(timeout=PATIENCE_S))).get("id") != number:
            pass
        assert "error" not in answer, answer
        return answer["result"]

    def value(self, expression: str) -> Any:
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"]["value"]

    def until(self, expression: str, is_wanted: Callable[[Any], bool]) -> Any:
        deadline = time.monotonic() + PATIENCE_S
        while not is_wanted(value := self.value(expression)):
            assert time.monotonic() < deadline, f"{expression} is {value}"
            time.sleep(0.1)
        return value

    def picture(self) -> bytes:
        return base64.b64decode(self.ask("Page.captureScreenshot")["data"])


@contextlib.contextmanager
def tab(page: str, folder: Path) -> Iterator[Browser]:
    """Chromium with the page in its only tab."""
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no Chromium: install the Debian package chromium")
    port_file = folder / "chromium/DevToolsActivePort"
    process = subprocess.Popen(
        [
            *(chromium, "--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1280,900"),
            *(f"--user-data-dir={folder}/chromium", "--remote-debugging-port=0", page),
        ],
        stderr=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + PATIENCE_S
        tabs: list[dict[str, Any]] = []
        while not tabs:
            assert time.monotonic() < deadline and process.poll() is None
            time.sleep(0.2)
            with contextlib.suppress(OSError, IndexError, http.client.HTTPException):
                port = port_file.read_text().splitlines()[0]
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
                    tabs = [one for one in json.load(answer) if one["url"].startswith(page)]
        with connect(tabs[0]["webSocketDebuggerUrl"], max_size=None) as connection:
            browser = Browser(connection)
            browser.until("typeof draw", lambda kind: kind == "function")  # the script has run
            yield browser
    finally:
        process.kill()
        process.wait()


def show(view: LiveView, configurations: np.ndarray, first: int) -> None:
    for number, q in enumerate(configurations, start=first):
        time_ns = BEGIN_NS + number * STEP_NS
        view(Topic.joint_states, JointState(time_ns, q, 0 * q), time_ns)


def tip(q: np.ndarray) -> list[float]:
    return np.asarray(arm().forward(q).position, float).tolist()


@pytest.mark.long
def test_a_browser_shows_what_is_painted_and_where_to_go_next(tmp_path: Path) -> None:
    way = MIDDLE + np.array([0.0, 0.2, 0.0, -0.2])
    way = way + np.linspace(-1.0, 1.0, 241)[:, None] * np.array([0.6, 0.15, 0.3, 0.45])  # in W+
    white, blue = np.array([255, 255, 255]), np.array([86, 180, 233])
    inwards = white + (blue - white) * abs(arm().pitch(way[20])) / FEW.pitch_max_rad
    with live_view(bobcat(), MACHINE_DIRECTORY, FEW, port=0) as (view,):
        assert isinstance(view, LiveView)
        show(view, way[:41], 0)
        with tab(f"http://{view._server.place}/", tmp_path) as browser:
            browser.until("document.getElementById('state').textContent", lambda text: text == "connected")
            first = browser.until("document.getElementById('share').value", lambda share: share > 0)
            show(view, way[41:], 41)
            browser.until("document.getElementById('share').value", lambda share: share > first)
            text = browser.until("document.getElementById('text').textContent", bool)
            share = browser.value("document.getElementById('share').value")
            (told,) = re.findall(r"painted ([\d.]+) % of what can be reached", text)
            assert float(told) == pytest.approx(100 * share, abs=0.06) and text.count("next: ") == 3
            for name in ("side", "top"):  # the arm's end is white; where it was before is painted by pitch
                drawn = f"({PIXELS_NEAR})('{name}', %s, %s)"
                browser.until(drawn % (tip(way[-1]), white.tolist()), lambda pixels: pixels >= 4)
                browser.until(drawn % (tip(way[20]), inwards.tolist()), lambda pixels: pixels >= 4)
            assert browser.value("clouds.painted.length") > 40
            (tmp_path / "page.png").write_bytes(browser.picture())
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"http://{view._server.place}/other")


def test_the_page_needs_no_other_file_and_no_network() -> None:
    page = page_of(bobcat()).decode()
    assert not re.search(r"(src|href)=|@import|url\(|https?://|import ", page)
