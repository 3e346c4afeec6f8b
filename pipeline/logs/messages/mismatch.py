"""What messages lack that the machine's configuration expects of them."""


class MismatchError(Exception):
    """Messages lack wanted content; the text says what is missing."""
