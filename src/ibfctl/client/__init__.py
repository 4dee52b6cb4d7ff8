"""The service from Python: `Client` speaks REST, returns what the service answers, and raises the product's errors."""

from ibfctl.client.client import Client
from ibfctl.client.transport import RefusedError, UnreachableError

__all__ = ["Client", "RefusedError", "UnreachableError"]
