"""Prepare IDL for `rosbags`, whose parser needs exponential time for nested expressions or sequences.

Comments, includes and annotations, which do not affect the serialisation, are removed. Operators, parentheses and deep
nesting, which `rosidl` never writes and which would cost that time, are refused.
"""

import re
from collections.abc import Iterator

TOKEN = re.compile(
    r"""(?P<left_out> \s+ | //[^\n]* | /\*.*?\*/ | \#[^\n]* )
      | (?P<string> "(?:\\.|[^"\\])*" )
      | (?P<annotation> @\s*[A-Za-z_]\w*(?:::[A-Za-z_]\w*)* )
      | (?P<name> (?:::)?[A-Za-z_]\w*(?:::[A-Za-z_]\w*)* )
      | (?P<number> [-+]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?) )
      | (?P<mark> [{}()<>\[\];,=:'] )""",
    re.VERBOSE | re.DOTALL,
)
MAXIMUM_ANGLES = 2  # a sequence of bounded strings
MAXIMUM_BRACES = 8
MAXIMUM_NUMBER_CHARACTERS = 32


def simplified_idl(text: str) -> str:
    """Return a definition without comments, includes and annotations, one space between its tokens.

    Raises:
        ValueError: The text holds an unsupported construct.
    """
    tokens = list(_tokens(text))
    kept: list[str] = []
    position = depth = braces = 0
    while position < len(tokens):
        kind, token = tokens[position]
        position += 1
        if kind == "annotation":
            position = _after_parameters(tokens, position)
            continue
        if token in "()":
            raise ValueError("IDL with expressions in parentheses is not read")
        depth += (token == "<") - (token == ">")
        braces += (token == "{") - (token == "}")
        if not 0 <= depth <= MAXIMUM_ANGLES or not 0 <= braces <= MAXIMUM_BRACES:
            raise ValueError("IDL is nested more deeply than is read")
        kept.append(token)
    return " ".join(kept)


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    """Yield kind and text of each token that is kept."""
    position = 0
    while position < len(text):
        match = TOKEN.match(text, position)
        if match is None:
            raise ValueError(f"IDL with `{text[position]}` is not read")
        position = match.end()
        kind = str(match.lastgroup)
        if kind == "number" and len(match[0]) > MAXIMUM_NUMBER_CHARACTERS:
            raise ValueError("a number in IDL is too long")
        if kind != "left_out":
            yield kind, match[0]


def _after_parameters(tokens: list[tuple[str, str]], position: int) -> int:
    """Return the position after an annotation and its parameters."""
    depth = 0
    while position < len(tokens):
        kind, token = tokens[position]
        depth += kind == "mark" and token == "("
        depth -= kind == "mark" and token == ")"
        if depth == 0:
            return position + (token == ")" and kind == "mark")
        position += 1
    raise ValueError("an annotation in IDL has no end")
