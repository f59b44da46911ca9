"""The CNS Flight Stack beside this package: its configuration imported, its nodes as peers of our engine. Pure.

`tables.py` holds what is known of it: names, types with md5 sums, words; `folder.py` and `importer.py` read a folder of its
configuration. Its messages come from the user's workspace, at run time; nothing of it is in this package.
"""
