"""What a network says when it is asked like a cell: open-circuit voltage, resistance, step response, rest."""

from models.readouts.tables import read_out, summary, tables_of

__all__ = ["read_out", "summary", "tables_of"]
