"""The page: one HTML file that shows a diagram, its orbits and its catalogue, without a network."""
