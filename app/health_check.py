"""`python -m app.health_check`: exit status 0 where the service of this container is ready.

Not urllib.request: it would ask a proxy where the environment names one.
"""

import http.client
import sys

from app.environment import own_variables

TIMEOUT_SECONDS = 4


def is_ready() -> bool:
    """Ask the service that listens where the environment says."""
    variables = own_variables()
    connection = http.client.HTTPConnection(
        variables.get("host", "127.0.0.1"), int(variables.get("port", 8000)), TIMEOUT_SECONDS
    )
    try:
        connection.request("GET", "/readyz")
        return connection.getresponse().status == http.HTTPStatus.OK
    except OSError:
        return False


if __name__ == "__main__":
    sys.exit(not is_ready())
