"""A learner of several processes: rank 0 leads, the others take in their lanes and train along."""
