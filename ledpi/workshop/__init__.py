"""Tools that a person runs beside the daemon: calibrate, evaluate, snapshot, panel, doctor."""
