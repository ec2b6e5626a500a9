"""Tests as sequences over states of charge: profiles, levels, rests, load cycles."""
