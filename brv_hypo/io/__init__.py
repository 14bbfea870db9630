"""Files in and out, guarded: whatever a file holds, reading it ends in data or in one readable refusal.

text.py             text of foreign origin without control codes; numbers; the one wording of a refused dataset
files.py            regular files only, text within a budget; files written whole or not at all
mappings.py         YAML and JSON within budgets of size, depth and expansion
sandbox.py          readers of binary files, run in a process of their own within limits
binary.py           HDF5 as a plain tree of datasets with units; columns of Parquet and MATLAB files
"""
