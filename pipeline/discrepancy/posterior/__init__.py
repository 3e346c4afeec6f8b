"""Which effects the logs show, and how probable each explanation is."""
