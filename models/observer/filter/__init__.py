"""The fuzzy observer itself, one compiled step live and in replay."""
