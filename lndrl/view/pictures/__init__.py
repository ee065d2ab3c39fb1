"""Drawings by matplotlib: worlds, films, trajectories, results and curves."""
