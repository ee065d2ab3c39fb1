"""Learning by a teacher's example: its phases, what is imitated, and what is made of it."""
