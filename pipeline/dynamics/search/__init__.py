"""What is searched over hyper-parameters, and which trial is selected."""
