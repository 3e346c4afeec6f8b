"""The thresholds in docs/closing_the_loop_method.md are those of the profile and of the code that each row links to."""

import importlib
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/closing_the_loop_method.md").read_text(encoding="utf-8")
PROFILE = yaml.safe_load((ROOT / "conf/profile/paper.yaml").read_text(encoding="utf-8"))["close_loop"]
NUMBER = r"(?: (\d+(?:\.\d+)?))?"
RULES = [
    (threshold, module)
    for threshold, module in re.findall(
        r"^\| [^|]* \| [^|]* \| ([^|]*) \| \[\w+\]\(\.\./([\w/]+)\.py\) \|", PAGE, re.MULTILINE
    )
]
KEYS = [found for threshold, _ in RULES for found in re.findall(rf"`(\w+)\.(\w+)`{NUMBER}", threshold)]
CONSTANTS = [
    (module, *found)
    for threshold, module in RULES
    for found in re.findall(rf"\b([A-Z]+(?:_[A-Z0-9]+)+|MOVED|CONSISTENT)\b{NUMBER}", threshold)
]


def test_the_page_has_rules() -> None:
    assert len(RULES) > 30 and len(KEYS) > 10 and len(CONSTANTS) > 20


@pytest.mark.parametrize(("section", "key", "stated"), [k for k in KEYS if k[0] != "Card"])
def test_keys_are_those_of_the_profile(section: str, key: str, stated: str) -> None:
    assert key in PROFILE[section]
    assert not stated or float(stated) == PROFILE[section][key]


@pytest.mark.parametrize(("module", "constant", "stated"), CONSTANTS)
def test_constants_are_those_of_the_code(module: str, constant: str, stated: str) -> None:
    value = getattr(importlib.import_module(module.replace("/", ".")), constant)
    values = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
    assert not stated or float(stated) in values
