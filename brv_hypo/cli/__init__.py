"""The command line.

main         `run`: the console script; which commands there are; mechanisms, config and docs
analyses     the commands compare, trace, predict and study
flights      the commands inspect, import, reconstruct, simulate and demo
session      options that commands share; where a command's results go; how it ends: messages, exit codes, signals
"""
