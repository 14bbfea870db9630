"""Effects that the residual loop tries: aerodynamics, instruments, wind. A file a subject."""
