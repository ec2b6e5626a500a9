"""Commissioning: what a bench's hardware says and does is looked at before anybody relies on it."""
