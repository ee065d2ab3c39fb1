"""The command that writes a page about a run or about results."""
