"""Rules that hold for one family of effects each."""
