"""Which tests `make check` runs for a change."""

import pytest

from tests.beside import files_beside

SOURCES = {
    "tests/conftest.py": "",
    "tests/logs/conftest.py": "",
    "tests/logs/helper.py": "",
    "tests/logs/formats/test_bags.py": "from pipeline.logs.formats.bags import read_log\n",
    "tests/logs/test_ingest.py": "from pipeline.logs import ingest, tuples\nfrom tests.logs.helper import make\n",
    "tests/study/test_ingest.py": "import pipeline.study.ingest\n",
    "tests/stages/test_dvc_graph.py": "",
    "tests/stages/test_search.py": "",
    "tests/test_docs.py": "",
}


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ("pipeline/logs/formats/bags.py", ["tests/logs/formats/test_bags.py"]),
        ("pipeline/logs/ingest.py", ["tests/logs/test_ingest.py", "tests/study/test_ingest.py"]),
        ("pipeline/logs/tuples.py", ["tests/logs/test_ingest.py"]),
        ("pipeline/logs/tuple.py", []),
        ("pipeline/logs/formats/__init__.py", []),
        ("tests/logs/test_ingest.py", ["tests/logs/test_ingest.py"]),
        ("tests/logs/helper.py", ["tests/logs/test_ingest.py"]),
        ("tests/logs/conftest.py", ["tests/logs/formats/test_bags.py", "tests/logs/test_ingest.py"]),
        ("docs/logs.md", ["tests/test_docs.py"]),
        ("tests/logs/test_gone.py", []),
        ("conf/search.yaml", ["tests/stages/test_search.py", "tests/test_docs.py"]),
        ("conf/profile/search.yaml", ["tests/test_docs.py"]),
        ("experiments/control_level/dvc.yaml", ["tests/stages/test_dvc_graph.py", "tests/test_docs.py"]),
    ],
)
def test_files_beside_a_change(changed: str, expected: list[str]) -> None:
    assert files_beside([changed], SOURCES) == expected


def test_a_test_that_changed_itself_comes_first() -> None:
    changed = ["pipeline/logs/formats/bags.py", "tests/study/test_ingest.py"]
    assert files_beside(changed, SOURCES) == ["tests/study/test_ingest.py", "tests/logs/formats/test_bags.py"]
