"""What runs, watches and tries the service over several processes and machines."""
