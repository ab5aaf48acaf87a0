"""The evaluation suites: what they ask a service, and the report that they make of its answers."""
