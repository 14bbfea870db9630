"""The command line.

main         `run`: the console script; which commands there are
options      the options that commands share, and what a shell completes
session      where a command's results go: terminal, JSON, report, files
exits        exit codes: what goes wrong, SIGINT and SIGTERM included, becomes one message
analyses (compare, trace, predict, study), flights (inspect, import, reconstruct, simulate, demo),
plugins (mechanisms, config, docs)     the commands
"""
