"""Watching a machine from session to session: healthy, changed, or not enough to tell."""
