"""From the bytes of messages, and the definitions beside them, to the fields that are wanted."""
