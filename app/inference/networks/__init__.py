"""What can run a checkpoint's network."""
