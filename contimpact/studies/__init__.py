"""Studies: many scenes, computed on many processes into one store."""
