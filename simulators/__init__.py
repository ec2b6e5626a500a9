"""Hardware that is not there: truth cells, a cycler, and servers that speak its protocol."""
