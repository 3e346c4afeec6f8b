"""MLflow's own page of compared runs, in a real headless Chromium: metrics line up, with a value in each column."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from mlflow import MlflowClient

from pipeline.tracking import TrackingConfiguration, track
from pipeline.tracking.metrics import flatten_metrics
from tests.tracking_server import tracking_server

pytestmark = pytest.mark.long

RESULTS = Path(__file__).parents[2] / "artifacts"
PAGE_TIMEOUT_S = 180


class Texts(HTMLParser):
    """The texts of a page in their order, without scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self._hidden = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self._hidden = tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False

    def handle_data(self, data: str) -> None:
        if data.strip() and not self._hidden:
            self.texts.append(data.strip())


def controllers() -> dict[str, dict]:
    """What `evaluate_brax` and `evaluate_icem` log of a policy and of a planner."""
    read = {
        name: json.loads((RESULTS / f"{folder}/{name}_mlp_dqdot/seed_0/metrics.json").read_text())
        for name, folder in (("ppo", "paper_tables/evaluate_brax"), ("icem", "evaluate_brax"))
    }
    read["ppo"]["average_return_full_reward"] = read["ppo"]["average_return"]
    return read


def before_and_after() -> dict[str, dict]:
    """What `close_loop` logs of the model as it was, and as it is with what was found."""
    error = json.loads((RESULTS / "close_loop/closed_loop.json").read_text())["error"]
    return {
        part: {"model": {metric: values[part] for metric, values in error.items()}}
        for part in ("before", "after")
    }


@pytest.fixture(scope="module")
def server(empty_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a server without runs."""
    folder = tmp_path_factory.mktemp("server")
    shutil.copy(empty_store, folder / "mlflow.db")
    with tracking_server(folder, f"sqlite:///{folder}/mlflow.db") as address:
        yield address


@pytest.mark.parametrize("compared", [controllers, before_and_after], ids=lambda made: made.__name__)
def test_compared_runs_have_a_value_of_every_common_metric(
    compared: Callable[[], dict[str, dict]], server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no Chromium: install the Debian package chromium")
    monkeypatch.chdir(tmp_path)
    configuration = TrackingConfiguration(True, server, None, compared.__name__)
    metrics = {name: flatten_metrics(tree) for name, tree in compared().items()}
    for name, values in metrics.items():
        with track(name, configuration, {"machine": {"name": "bobcat_e10"}}, "") as run:
            run.metrics(values)
    client = MlflowClient(server)
    experiment = client.get_experiment_by_name(compared.__name__).experiment_id
    runs = sorted(client.search_runs([experiment]), key=lambda run: run.info.start_time)
    asked = quote(json.dumps([run.info.run_id for run in runs], separators=(",", ":")), safe=",")
    page = subprocess.run(
        [
            *(chromium, "--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1600,2400"),
            *(f"--user-data-dir={tmp_path}/chromium", "--virtual-time-budget=30000", "--dump-dom"),
            f"{server}/#/compare-runs?runs={asked}&experiments=%5B%22{experiment}%22%5D",
        ],
        capture_output=True,
        text=True,
        timeout=PAGE_TIMEOUT_S,
        check=True,
    ).stdout
    texts = Texts(page).texts
    begin = len(texts) - texts[::-1].index("Metrics") + 1  # behind the switch "Show diff only"
    table = texts[begin : texts.index("Artifacts", begin)]

    first, second = metrics.values()
    common = sorted(first.keys() & second.keys())
    names = [text for text in table if not re.fullmatch(r"NaN|-?[\d.]+(e[+-]?\d+)?", text)]
    assert names == sorted(first.keys() | second.keys()) and len(common) > 6
    shown = np.array(table[len(names) :], float).reshape(len(names), len(metrics))
    for column, values in zip(shown.T, (first, second), strict=True):
        assert column[[names.index(name) for name in common]] == pytest.approx(
            [values[name] for name in common], rel=1e-2, abs=1e-3
        )
