"""HTTP: schemas, routes, errors, and the service behind the routes."""
