"""How long the tool stays: removal operators, bounds from the machine, solvers."""
