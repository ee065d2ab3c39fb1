"""What the machine and its operating system give: cores, locks, signals."""
