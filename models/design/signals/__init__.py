"""One family of test signals in each module, as `FAMILY`; a new module appears everywhere by itself."""
