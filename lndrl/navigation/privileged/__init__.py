"""What only the value network may see while it learns: the truth about the belief, as floats."""
