"""What a run leaves on disk: its folder, checkpoints, metrics, events and how lines are written."""
