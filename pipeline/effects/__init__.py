"""The catalogue of effects that a learned model may lack: one card and one differentiable wrapper per file."""
