"""The notes of a log while it is read: equal ones are counted into one, and their number is bounded."""

import re
from collections import Counter
from dataclasses import replace
from typing import SupportsIndex

from pipeline.logs.messages.raw_log import Note

MAXIMUM_ALIKE = 10  # notes that differ in numbers only, such as the place
MAXIMUM_NOTES = 200
MORE = " (and more like this, which are counted only)"
NUMBER = re.compile(r"\d+")


class NoteList(list[Note]):
    """A list whose `append` counts notes into earlier ones; the sum of all counts stays that of the notes appended.

    Equal notes become one. Of notes that differ in numbers only, ten are listed and the others counted into one more.
    """

    def __init__(self) -> None:
        super().__init__()
        self.places: dict[str, int] = {}  # in the list, by text or by what alike texts have in common
        self.n_alike: Counter[str] = Counter()

    def append(self, note: Note) -> None:
        """Add a note, or its count to another's."""
        if self._counted(note.text, note):
            return
        alike = without_numbers(note.text)
        key = text = note.text
        if self.n_alike[alike] >= MAXIMUM_ALIKE:
            key, text = alike, f"{note.text}{MORE}"
        elif len(self) < MAXIMUM_NOTES:
            self.n_alike[alike] += 1
        else:
            key, text = f"further {note.kind}", "further notes, which are counted only"
        if not self._counted(key, note):
            self.places[key] = len(self)
            super().append(replace(note, text=text))

    def __delitem__(self, key: SupportsIndex | slice) -> None:
        super().__delitem__(key)
        self.places = {text: place for text, place in self.places.items() if place < len(self)}

    def _counted(self, key: str, note: Note) -> bool:
        """Count a note into an earlier one of that key, if there is one of its kind."""
        place = self.places.get(key)
        if place is None or self[place].kind is not note.kind:
            return False
        self[place] = replace(self[place], count=self[place].count + note.count)
        return True


def without_numbers(text: str) -> str:
    """What texts about several places have in common."""
    return NUMBER.sub("#", text)
