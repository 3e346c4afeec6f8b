"""Search over hyper-parameters, and selection of a trial."""
