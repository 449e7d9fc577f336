"""Error against run time: 30-digit references, and the alternative a user would write."""
