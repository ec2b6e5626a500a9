"""One control process per bench: player, clock, safety, recording, live observer; and its supervisor."""
