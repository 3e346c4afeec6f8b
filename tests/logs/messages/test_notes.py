from pipeline.logs.messages.notes import MAXIMUM_ALIKE, MAXIMUM_NOTES, NoteList
from pipeline.logs.messages.raw_log import Note, NoteKind


def test_equal_notes_are_counted_into_one():
    notes = NoteList()
    for count in (1, 2, 3):
        notes.append(Note(NoteKind.left_out, "a row repeats", count))
    notes.append(Note(NoteKind.damage, "a row repeats"))
    assert notes == [Note(NoteKind.left_out, "a row repeats", 6), Note(NoteKind.damage, "a row repeats")]


def test_of_alike_notes_ten_are_listed_and_all_are_counted():
    notes = NoteList()
    for row in range(200_000):
        notes.append(Note(NoteKind.damage, f"a.db3: row {row} has no time", 2))
    assert len(notes) == MAXIMUM_ALIKE + 1 and sum(note.count for note in notes) == 400_000
    assert notes[0].text == "a.db3: row 0 has no time" and "counted only" in notes[-1].text


def test_notes_without_likeness_are_bounded_too():
    notes = NoteList()
    letters = [first + second for first in "abcdefghijklmnopqrst" for second in "abcdefghijklmnopqrst"]
    for topic in letters:
        notes.append(Note(NoteKind.damage, f"topic {topic} is damaged"))
    assert len(notes) == MAXIMUM_NOTES + 1 and sum(note.count for note in notes) == len(letters)


def test_deleted_notes_take_no_more_counts():
    notes = NoteList()
    notes.append(Note(NoteKind.damage, "kept"))
    notes.append(Note(NoteKind.damage, "deleted"))
    del notes[1:]
    notes.append(Note(NoteKind.damage, "other"))
    notes.append(Note(NoteKind.damage, "deleted"))
    assert [(note.text, note.count) for note in notes] == [("kept", 1), ("other", 1), ("deleted", 1)]
