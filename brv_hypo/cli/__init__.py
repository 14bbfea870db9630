"""The command line: main.py has `run`, the console script; session.py what commands share."""
