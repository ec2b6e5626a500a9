"""Runs, samples, models, campaigns: two databases in one data directory.

``meta.sqlite`` is written by the API process alone, ``samples.sqlite`` by the recorder alone; everybody else reads.
"""
