"""Beyond one machine: the service on a cluster."""
