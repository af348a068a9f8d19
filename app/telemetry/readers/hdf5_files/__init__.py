"""Files in HDF5: what they hold as arrays and tables, plain or by another program's conventions."""
