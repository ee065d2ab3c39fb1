"""Learner and actors on the hosts that a file names: started by ssh or Slurm, ended together."""
