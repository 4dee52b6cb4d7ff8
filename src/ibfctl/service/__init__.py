"""The REST service: no numerics, no motion; plans and runs happen in processes of their own."""
