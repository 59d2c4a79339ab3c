"""The languages of machines, one module each: a Program becomes the bytes of a file."""
