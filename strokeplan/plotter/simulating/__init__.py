"""Firmwares of plotters as state machines in time: bytes in, bytes out, and what the pen drew."""
