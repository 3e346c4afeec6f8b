"""The blind benchmark of `close_loop`: one program draws and seals cases, one solves them, one scores.

The three know nothing of each other but files: `ROOT/cases` (bags), `ROOT/seals` (truths), `ROOT/solutions`.
"""
