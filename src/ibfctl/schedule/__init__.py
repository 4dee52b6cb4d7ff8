"""How the axes move: Hermite cubics, their velocities by a quadratic programme, integers, and the certificate."""
