"""Pages of single commands: the quality of logs, the judgement of models, the closed loop, the demonstration."""
