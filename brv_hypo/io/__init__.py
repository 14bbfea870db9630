"""Files in and out, guarded: whatever a file holds, reading it ends in data or in one readable refusal.

text.py             text of foreign origin without control codes; the one wording of a refused dataset
reading.py          regular files only, and text within a budget
mappings.py         YAML and JSON within budgets of size, depth and expansion
atomic.py           files written whole or not at all; lines appended whole or not at all
sandbox.py          HDF5, Parquet and MATLAB files, read by a process of their own (sandbox_worker.py)
hdf5.py             HDF5 as a plain tree of datasets with units
"""
