"""What is asked and what is found, as data and as files: scenes, branches, diagrams, catalogues."""
