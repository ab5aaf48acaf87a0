"""The domain: plant, prior, methods, metrics and planner. No network library, no web, no I/O."""
