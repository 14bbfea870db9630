"""Results as documents, rendered to the terminal, to pages and to picture files; nothing below imports it.

blocks.py          what a document is made of: tables, texts, charts
compare.py, trace.py, prediction.py, reconstruction.py, study.py     from a result to its document
terminal.py, pages.py, drawing.py      a document in the terminal, as an HTML page, its charts as PNG and SVG
chart.py           what a chart shows; plotly_chart.py for pages
*_charts.py        the charts of each result; chart_names.py those that it has whatever the flight
rows.py, study_rows.py, style.py       rows of tables, and how numbers are written
write.py           write_report, write_figures: any result, from Python
provenance.py      version, settings, digests of records, command
flight.py, simulate.py, mechanisms.py  what else the terminal shows, and as data for JSON
picture.py         the README's picture
"""
