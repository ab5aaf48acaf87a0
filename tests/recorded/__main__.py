"""`python -m tests.recorded URL`: put the answers of a running service on record.

Only where answers change on purpose: the test beside this file keeps them as they are.
"""

import json
import sys

import httpx

from tests.recorded.requests import ANSWERS, all_requests

if __name__ == "__main__":
    with httpx.Client(base_url=sys.argv[1], timeout=60) as client, ANSWERS.open("w") as file:
        for path, request, _ in all_requests():
            answer = client.post(path, json=request).raise_for_status().json()
            del answer["timing_ms"]
            for segment in answer.get("segments", ()):
                del segment["timing_ms"]
            file.write(json.dumps(answer) + "\n")
