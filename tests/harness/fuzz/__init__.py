"""Mutated inputs of every format to every command: none may end in a fault, a crash, a hang or litter.

    python -m tests.harness.fuzz --inputs 10000 --seed 1 --save FOLDER

mutations.py  operations on bytes, text, trees and HDF5 records, each fixed by its seed
targets.py    a valid input of every format, and the command that reads it
run.py        one input: mutated, given to its command, judged, and made smaller where it fails
"""
