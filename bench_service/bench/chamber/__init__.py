"""The temperature chamber of a bench: a second device, never in the way of the first one."""
