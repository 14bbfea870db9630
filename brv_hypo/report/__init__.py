"""Results as documents, rendered to the terminal, to pages and to picture files; nothing below imports it.

document           what a document is made of: tables, texts, charts
tables             rows of tables; style: how numbers are written
motion_charts      charts that several results share
comparison, trace, prediction, reconstruction, study     from a result to its document, with its charts
listings           an inspected record, the installed mechanisms, a simulated flight
terminal, html, figures      a document in the terminal, as an HTML page (plotly), its charts by matplotlib
write              write_report, write_figures, plot: any result, from Python
"""
