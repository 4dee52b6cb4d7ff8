"""DMC programs: their memory, their threads, and the engine that runs them."""
