"""How far moments and forces of a body depart from proportion to the angle of attack."""

from __future__ import annotations

# Angle of attack (rad) at which what bends may be as large as what is in proportion (1 sigma): about ten degrees.
BENT = 0.2
