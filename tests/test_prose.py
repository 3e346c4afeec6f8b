"""The pages can be read: short sentences, paragraphs and lines, and no history outside the benchmark's page."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GENERATED = "<!-- generated:"  # the first line of a page, or of a part of it, that a program writes
PAGES = [
    page
    for page in (ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md")))
    if not page.read_text(encoding="utf-8").startswith(GENERATED)
]
LONGEST_SENTENCE = 35  # words
LONGEST_PARAGRAPH = 120  # words
LONGEST_LINE = 120  # characters
ALL_WORDS = 18_000
README_LINES = 100

GENERATED_PART = re.compile(rf"{GENERATED}.*?<!-- end of what is generated -->", re.DOTALL)
CODE_BLOCK = re.compile(r"^ *```.*?^ *```$", re.DOTALL | re.MULTILINE)
BLOCK_START = re.compile(r"^(\s*([-*+]|\d+\.)|#+) ")  # list items and headings are blocks of their own
SENTENCE_END = re.compile(r"(?<=[.!?])[)\"'*]*\s+")
WORD = re.compile(r"\w")
COMMIT_OR_CASE = re.compile(
    r"\b(?=[0-9a-f]*[a-f])(?=[0-9a-f]*\d)(?:[0-9a-f]{7,8}|[0-9a-f]{12}|[0-9a-f]{40})\b"
)


def without_code_blocks(text: str) -> str:
    return CODE_BLOCK.sub("", re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))


def without_link_targets(text: str) -> str:
    return re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)


def paragraphs(text: str) -> Iterator[str]:
    """Running text alone: no code, no tables, no link targets; each list item and heading by itself."""
    lines: list[str] = []
    for line in [*without_link_targets(without_code_blocks(text)).splitlines(), ""]:
        is_table = line.lstrip().startswith("|")
        if lines and (not line.strip() or is_table or BLOCK_START.match(line)):
            yield " ".join(lines)
            lines = []
        if line.strip() and not is_table:
            lines.append(re.sub(BLOCK_START, "", line).strip())


def words(text: str) -> int:
    """A piece of code counts as one word."""
    return all_words(re.sub(r"`[^`]*`", "code", text))


def all_words(text: str) -> int:
    """Code and tables included, without the bars and dashes between them."""
    return sum(bool(WORD.search(word)) for word in text.split())


def too_long_sentences(text: str) -> list[str]:
    sentences = (s for paragraph in paragraphs(text) for s in SENTENCE_END.split(paragraph))
    return [sentence for sentence in sentences if words(sentence) > LONGEST_SENTENCE]


def too_long_paragraphs(text: str) -> list[str]:
    return [paragraph for paragraph in paragraphs(text) if words(paragraph) > LONGEST_PARAGRAPH]


def too_long_lines(text: str) -> list[str]:
    lines = without_code_blocks(text).splitlines()
    return [
        line
        for line in lines
        if not line.lstrip().startswith("|") and len(without_link_targets(line)) > LONGEST_LINE
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_are_readable(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not too_long_sentences(text)
    assert not too_long_paragraphs(text)
    assert not too_long_lines(text)


@pytest.mark.parametrize("page", [p for p in PAGES if p.name != "benchmark.md"], ids=lambda page: page.name)
def test_history_belongs_to_git(page: Path) -> None:
    """Commits and benchmark cases are named on the benchmark's page alone."""
    assert not COMMIT_OR_CASE.findall(page.read_text(encoding="utf-8"))


def test_readme_is_two_screens() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= README_LINES


def test_all_pages_together() -> None:
    by_hand = {page.name: GENERATED_PART.sub("", page.read_text(encoding="utf-8")) for page in PAGES}
    counts = {name: all_words(text) for name, text in by_hand.items()}
    assert sum(counts.values()) <= ALL_WORDS, counts


def test_the_checks_find_what_they_look_for() -> None:
    long = " ".join(["word"] * 36)
    assert too_long_sentences(f"Short. {long}.\n\n- item\n- {long}") == [f"{long}.", long]
    assert not too_long_sentences(f"| {long} |\n\n```\n{long}\n```\n\n{'word ' * 20}\n\n{'word ' * 20}")
    assert not too_long_sentences("`a b c` " * 35)
    assert too_long_paragraphs("One two three. " * 41) and not too_long_paragraphs("One two three. " * 40)
    assert too_long_lines("x" * 121) and not too_long_lines(f"[x]({'x' * 121})")
    assert COMMIT_OR_CASE.findall("made at `74d34a3`, case 62fd172162e1") == ["74d34a3", "62fd172162e1"]
    assert not COMMIT_OR_CASE.findall("1000000 steps, 2026-11-27, deadbeef, feedback")
