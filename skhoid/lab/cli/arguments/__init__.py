"""The arguments of each command, for the parser: importing them imports no NumPy."""
