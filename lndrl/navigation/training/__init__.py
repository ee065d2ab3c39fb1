"""What worlds do in training alone: second tries, and replicas of the robot's filter."""
