"""Noise and settings of the observer from records."""
