"""``lndrl bench fleet``: how many actors one learner carries, with synthetic ones."""
