"""Errors that the user can correct, each with a message of one line."""


class InputError(Exception):
    """Bad input: the message is one line that names the file, the place and the remedy.

    Stages print the message and exit with status 2; no traceback is shown.
    """

    def __init__(self, message: str) -> None:
        line = " ".join(message.split())
        # Text read from a damaged file must not move the cursor or colour the terminal.
        super().__init__(
            "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line)
        )


def counted(number: int, what: str) -> str:
    """A number of things in words: `1 log`, `2 logs`."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def first_line(error: BaseException) -> str:
    """The first line of an error's message; its type if it has no message."""
    return (str(error).splitlines() or [type(error).__name__])[0]
