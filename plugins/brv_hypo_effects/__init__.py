"""Effects that the residual loop tries: aerodynamics, asymmetries, instruments, vehicle, wind. A file a family."""
