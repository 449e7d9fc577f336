"""One smooth piece of an orbit between two walls: its formulas as code, and what happens on it."""
