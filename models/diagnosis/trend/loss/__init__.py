"""What a lost capacity comes from: losses that a cell may have, each held against a run, and what is named of them."""
