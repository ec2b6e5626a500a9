"""The search for the current that tells most inside its limits."""
