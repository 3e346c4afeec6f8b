"""Files and folders: atomic writes, checks before work starts, clean-up after it."""
