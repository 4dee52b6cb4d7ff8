"""``python -m benchmarks._load URL RATE_HZ``: GET requests at a rate, until the end of standard input."""

from __future__ import annotations

import sys
import threading
import time

import httpx

THREADS = 4
PLACES = ("/v1/info", "/v1/runs?limit=5", "/v1/plans?limit=5", "/v1/machine", "/healthz")


def main() -> None:
    """Ask in several threads, each at its share of the rate."""
    url, rate_hz = sys.argv[1], float(sys.argv[2])
    ended, counts = threading.Event(), [0] * THREADS

    def ask(number: int) -> None:
        due = time.monotonic()
        with httpx.Client(base_url=url, timeout=30) as client:
            while not ended.is_set():
                client.get(PLACES[counts[number] % len(PLACES)]).raise_for_status()
                counts[number] += 1
                due += THREADS / rate_hz
                ended.wait(max(due - time.monotonic(), 0.0))

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(THREADS)]
    begun = time.monotonic()
    for thread in threads:
        thread.start()
    sys.stdin.read()
    ended.set()
    for thread in threads:
        thread.join()
    print(sum(counts) / (time.monotonic() - begun))


if __name__ == "__main__":
    main()
