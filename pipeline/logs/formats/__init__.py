"""Files of every format, whole or damaged, to blocks of undecoded messages."""
