"""What drives robots, stands in for them, and looks at what they recorded."""
