"""Many scenes as one study: their parameters, their computation on many processes, their store."""
