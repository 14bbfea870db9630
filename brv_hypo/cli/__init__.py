"""The command line.

main.py        `run`: the console script; which commands there are
options.py     the options that commands share
signals.py     SIGINT and SIGTERM
guard.py       exit codes: what goes wrong becomes one message
session.py     where a command's results go: terminal, JSON, report, files
compare.py, study.py, ...  the commands, one file for each or for a small group
"""
