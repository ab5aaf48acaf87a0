"""What can be reached at all: the exact reachable set, and the floor of the error."""
