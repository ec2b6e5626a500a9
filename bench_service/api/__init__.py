"""REST and WebSocket interface, one file per resource; routes translate, they decide nothing."""
