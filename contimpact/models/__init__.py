"""What the author of a system writes, and how it is checked. Knows no solver."""
