"""Files, locks and plain data: how things are written, kept and read back, whatever they say."""
