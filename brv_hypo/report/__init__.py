"""Results as tables and pages; nothing here computes, and nothing below imports it.

style.py           the one look of tables, and how numbers are written
rows.py            a comparison's rows, the same in the terminal and on the page
compare.py, reconstruction.py, flight.py, simulate.py, mechanisms.py    for the terminal, and as data for JSON
pages.py           what an HTML page is made of; compare_page.py, reconstruction_page.py are pages
figures.py         from arrays to plotly figures
study.py, study_rows.py, study_figures.py, study_page.py           a study, likewise
picture.py         the README's picture
"""
