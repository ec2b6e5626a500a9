"""Talking to a battery cycler: device maps, codecs, transports and the `Cycler` protocol."""
