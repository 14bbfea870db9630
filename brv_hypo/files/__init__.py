"""Files in and out, guarded: whatever a file holds, reading it ends in data or in one readable refusal.

regular.py        regular files only, and text within a budget
mappings.py       YAML and JSON within budgets of size, depth and expansion
printed.py        text of foreign origin, without control codes
library.py        HDF5, Parquet and MATLAB files, read by a process of their own (library_child.py)
whole.py          files written whole or not at all; lines appended whole or not at all
"""
