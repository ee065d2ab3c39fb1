"""What makes policies: one run, all methods of the bench, sweeps, and their curves."""
