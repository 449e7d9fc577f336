"""From impact to impact in time: the engine, chatter and sticking, Lyapunov exponents."""
