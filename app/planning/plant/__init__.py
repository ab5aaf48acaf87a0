"""The plant: its friction law, and what follows from it."""
