"""Results as data: tables, entries, catalogues, and the folders that hold them."""
