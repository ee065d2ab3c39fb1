"""A run's figures for Weights & Biases and MLflow, read from its folder by a process of its own.

Nothing here is imported by a learner: whatever these tools do, training goes on. Import from the
modules themselves; the tools are optional, and imported when a run is sent to them.
"""
