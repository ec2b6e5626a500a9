"""Effects in the temperature of a cell: the heat balance as the diagnosis sees it."""
