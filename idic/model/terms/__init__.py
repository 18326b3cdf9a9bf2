"""Physics that are declared whole, one file each: unknowns, effect with its derivatives, words for the diagnosis."""
