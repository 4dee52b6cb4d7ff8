"""An emulated Galil DMC-40x0/41x3: physics, interpreter and TCP server, written from the manuals alone."""
