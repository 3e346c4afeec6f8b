"""Conditioning: from samples as recorded to streams that can be resampled."""
