"""Plain functions compiled to machine code, kept in the cache."""
