"""The observer of a module of unequal cells."""
