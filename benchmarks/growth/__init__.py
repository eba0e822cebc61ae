"""How time and memory of each kind of work grow with the rows: a part per file."""
