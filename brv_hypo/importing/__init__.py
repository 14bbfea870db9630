"""Foreign records: a table of any recorder becomes a `Flight` through a map of its columns (record_map.py), which
`guess_map` drafts (guess.py). Each file in formats/ is a format that can be read.
"""

from brv_hypo.importing.record_map import Imported, bring_in, import_record

__all__ = ["Imported", "bring_in", "import_record"]
