"""Results as documents, rendered to the terminal, to pages and to picture files; nothing below imports it.

document           what a document is made of: tables, texts, charts
tables             what tables and sentences show of comparisons and terms
motion_charts      charts that several results share
comparison, trace, reconstruction, many_flights     from a result to its document, with its charts
listings           an inspected record, the installed mechanisms, a simulated flight: blocks and JSON
terminal, html, figures      a document in the terminal, as an HTML page (page/*.j2, plotly), its charts by matplotlib
write              write_report, write_figures, plot: any result, from Python
"""
