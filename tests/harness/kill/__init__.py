"""`kill -9` at random moments of every command that writes, some on a full disk: whole files, no litter, flights once.

    python -m tests.harness.kill --runs 300 --full 50 --seed 1

commands.py   every command that writes, its inputs, its outputs, and what makes each whole
disk.py       a folder with little room: a small file system where this process may mount one, else a limit
victim.py     the process that is killed: when, and what it leaves running
run.py        one run: killed, judged, done again to its end, judged
"""
