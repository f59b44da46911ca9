"""What a recording says, whatever wrote it: its messages in one order, their fields, statuses and journals in it."""
