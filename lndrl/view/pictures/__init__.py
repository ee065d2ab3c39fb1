"""Drawings by matplotlib: worlds, films, trajectories, curves and reports."""
