"""Results as documents (document.py), rendered to the terminal, pages and picture files; nothing below imports it."""
