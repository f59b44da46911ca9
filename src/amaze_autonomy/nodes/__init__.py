"""The rospy shells: thin. They turn messages and replies into events, and commands into calls; they decide nothing.

`incoming.py`, `outgoing.py` translate; `clock.py` reads the clocks; `service_client.py` calls a service within a time
limit; `requests.py` says which command is which service; `engine_thread.py` is the one thread that decides; `outbox.py`
writes and publishes what it decided, after it was carried out.
"""
