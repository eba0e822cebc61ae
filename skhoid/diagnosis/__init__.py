"""What a fitted model misses, and what recordings hold: scores, remnant, checks."""
