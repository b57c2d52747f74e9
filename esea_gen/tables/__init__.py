"""The one reader of tables: CSV, MATLAB, HDF5, Parquet and JSON, alike for every command.

A table is read completely or refused; whatever is left out is counted and reported.

>>> table = read_table(Path("rig.csv"), ("t", "tau"))
>>> time_s, tau_Nm = table.numbers("t"), table.numbers("tau")
>>> print(table.report())

Rows without a time are refused by ``numbers``, or left out and counted by ``table.timed("t")``.
"""

from esea_gen.tables.reader import read_table
from esea_gen.tables.table import MARK, SIMULATED, FileTable, TableFormat, numbered

__all__ = ["MARK", "SIMULATED", "FileTable", "TableFormat", "numbered", "read_table"]
