"""Runs that other programs wrote: a file of any cycler is looked at, guessed, asked about, read and mended.

The way of a file: `signatures` (what is it?), `dialect` (how is it written?), `cyclers` and `guess` (what is in which
column, and why?), `text_table` or `arrow_table` (its rows, block by block), `assemble` (SI units), `spool` (columns of
any length), `clean` (faults of time), `settle` and `votes` (units and sign), `output`.
"""
