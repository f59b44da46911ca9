"""The CNS Flight Stack beside this package: its configuration imported, its nodes as peers of our engine. Pure.

`tables.py` holds what is known of it: names, types with md5 sums, words; `folder.py` reads its configuration, and
`importer.py` makes ours of it. Its messages come from the user's workspace, at run time; nothing of it is here.
"""
