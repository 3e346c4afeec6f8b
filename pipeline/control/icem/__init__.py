"""Model predictive control with iCEM, the improved cross-entropy method.

C. Pinneri, S. Sawant, S. Blaes, J. Achterhold, J. Stueckler, M. Rolinek and G. Martius: Sample-efficient
Cross-Entropy Method for Real-time Planning. Conference on Robot Learning, 2020 (PMLR 155, 2021).
"""
