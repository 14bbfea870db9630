"""Foreign records: a table of any recorder becomes a `Flight` through a map of its columns.

formats/        the formats that can be read, and their columns by name: a new one is one file
record_map.py   MAP.yaml, and the flight that is made by it: `bring_in`, `import_record`
rocket_log.py   what a raw log needs: one clock, one inertial unit, biases from the pad, speed of a climb, a lower rate
guess.py        `guess_map`: a commented map, proposed from names and physics, by the template map.yaml.j2
guess_rules.py  what names and numbers say of a column
"""

from brv_hypo.importing.record_map import Imported, bring_in, import_record

__all__ = ["Imported", "bring_in", "import_record"]
