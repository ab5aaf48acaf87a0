"""The client side: it speaks HTTP and shares the schemas, and knows nothing of the service."""
