"""What travels between a service and who asks it: requests, answers, problems."""
