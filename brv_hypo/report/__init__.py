"""Results as tables and pages; nothing here computes.

style.py       the one look of tables, and how numbers are written
mechanisms.py  the installed mechanisms
"""
