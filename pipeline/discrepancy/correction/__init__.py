"""The model with the effects that were accepted, its errors, and those of other corrections."""
