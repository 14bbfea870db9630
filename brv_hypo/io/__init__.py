"""Files in and out, guarded: whatever a file holds, reading it ends in data or in one readable refusal.

text.py             text of foreign origin without control codes; the one wording of a refused dataset
reading.py          regular files only; text, YAML and JSON within budgets of size, depth and expansion
atomic.py           files written whole or not at all
sandbox.py          readers of binary files, run in a process of their own within limits
binary.py           HDF5 as a plain tree of datasets with units; columns of Parquet and MATLAB files
"""
