"""The reference model of the diagnosis: linear, without output feedback, and the records it is held against."""
