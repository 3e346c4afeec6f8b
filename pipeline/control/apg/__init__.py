"""Analytic policy gradient: a policy is improved along the gradient of its return through the learned model.

The idea is that of Wiedemann et al., Training Efficient Controllers via Analytic Policy Gradient (ICRA 2023). Commands
are discrete here, so their gradient is that of a smooth step (Bengio et al., 2013, straight-through estimator).
"""
