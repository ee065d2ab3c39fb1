"""What measures and shows policies, filters and places."""
