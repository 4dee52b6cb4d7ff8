"""Where the tool goes: nodes in order, dwell points between them."""
