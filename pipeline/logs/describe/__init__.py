"""What foreign logs hold, and a draft of the machine's configuration that reads them."""
