"""The built-in transition mechanisms, one file each: Table 2.1 and Section 5.3 of the report."""
