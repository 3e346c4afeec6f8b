"""Tables and the plot of a ledger."""
def write_score(rows, markdown, plot):
    raise NotImplementedError
