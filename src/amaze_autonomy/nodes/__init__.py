"""The rospy shells: thin. They turn messages and replies into events, and commands into calls; they decide nothing.

`interface.py` gives the tables of `interface/` the classes of ROS; `clock.py` reads clocks; `service_client.py` calls
a service within a time limit; `asker.py` knows who asks one of ours; `requests.py` carries out requests;
`engine_thread.py` is the one thread that decides; `outbox.py` publishes and writes what it decided, after it was
carried out.
"""
