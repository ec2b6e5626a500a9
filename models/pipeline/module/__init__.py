"""Modules: the network of their mean cell, the module models S1 to S4, and what differs from group to group."""
