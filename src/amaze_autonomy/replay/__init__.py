"""Offline replay: recorded bags through the decision code of the flight, faster than real time, bit for bit repeatable.

`amaze-replay run` makes events of a bag's samples and decides them; `amaze-replay journal` decides a flight's journal
again and compares. Neither needs ROS.

`recordings/` reads bags, logs and journals, `maps/` says what their topics are, `monitors/` judges their samples,
`peers/` answers for the other nodes, `faults/` makes things go wrong. `session.py` is one replay of all this, from its
`plan.py`; `timeline.py` and `report.py` tell of it, `compare.py` decides journals again.
"""
