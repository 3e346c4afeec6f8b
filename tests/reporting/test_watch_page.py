"""The page of watched machines: what it says of a document, and that it needs no other file."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.errors import InputError
from pipeline.reporting.pages.watch import write
from pipeline.watch.course import follow
from pipeline.watch.document import document_of
from pipeline.watch.session_store import SessionRecord, listed
from pipeline.watch.settings import WatchConfig
from pipeline.watch.statistics import STATISTICS

JOINTS = ["lift", "turn"]
SPREAD = np.array([statistic.least / 3.0 for statistic in STATISTICS])
DAY_NS = 86_400 * 10**9


def document(changed_from: int, growth: float = 0.0) -> dict[str, object]:
    """Of thirty sessions; lateness of `turn` jumps, or grows, from one on."""
    random, n = np.random.default_rng(changed_from), 30
    values = SPREAD * random.standard_normal((10 + n, 2, len(SPREAD)))
    late = growth * np.arange(1, n + 1) if growth else np.full(n, 0.05)
    values[10 + changed_from :, 1, 2] += late[: n - changed_from]
    records = [
        SessionRecord(str(day), f"day_{day}", "", [], day * DAY_NS, day * DAY_NS + 1, "", listed(of))
        for day, of in enumerate(values[10:], start=20_000)
    ]
    course = follow(values[:10], values[10:], [], load_section("watch", WatchConfig, "paper"))
    found = document_of("two_joints", JOINTS, records, course, 20.0)
    return found | {"not_counted": [{"name": "broken", "why": "broken.mcap: <not> readable"}]}


def page_of(folder: Path, documents: dict[str, dict[str, object]]) -> str:
    for name, content in documents.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "watch.json").write_text(json.dumps(content))
    write(folder, folder / "fleet.html")
    return (folder / "fleet.html").read_text()


def test_changed_machines_come_first_with_what_changed(tmp_path: Path) -> None:
    page = page_of(tmp_path, {"a_sound": document(30), "b_late": document(20)})
    assert "Changed: b_late." in page
    assert page.index("<td>b_late</td>") < page.index("<td>a_sound</td>")
    assert "turn: lateness" in page and "began with session day_20020" in page
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)  # no other file
    assert "&lt;not&gt; readable" in page and "width=device-width" in page


def test_a_limit_ahead_is_told_of_what_grows(tmp_path: Path) -> None:
    page = page_of(tmp_path, {"growing": document(10, growth=0.008)})
    told = re.search(r"It reaches 0\.3 s in (\d+) to (\d+) sessions", page)
    assert told is not None
    ahead = 0.3 / 0.008 - 20  # by how the sessions were drawn
    assert int(told[1]) <= np.ceil(ahead) <= int(told[2])


def test_a_machine_without_sessions_has_a_page(tmp_path: Path) -> None:
    empty = {"machine": "m", "state": "not_enough", "e_value": 1.0, "alarm_at": 20.0}
    page = page_of(tmp_path, {".": empty | {"sessions": [], "findings": [], "not_counted": []}})
    assert "No session yet." in page and "<td>m</td>" in page
    with pytest.raises(InputError, match=r"holds no watch\.json"):
        write(tmp_path / "nothing", tmp_path / "page.html")
