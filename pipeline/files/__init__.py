"""Files and folders: written whole, checked before work starts, cleaned up after it."""
