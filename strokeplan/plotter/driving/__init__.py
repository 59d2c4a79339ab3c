"""Driving a machine: a program goes over a port, line by line of the pen, and what has been drawn is kept on disk."""
