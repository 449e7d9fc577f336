"""All pictures. The only modules that import matplotlib."""
