"""The learned model f_θ: its inputs, its networks, its rollout, its folder."""
