"""Learning curves: of one run, of several, of the runs of a sweep."""
