"""Offline replay: recorded bags through the decision code of the flight, faster than real time, bit for bit repeatable.

`amaze-replay run` makes events of a bag's samples and decides them; `amaze-replay journal` decides a flight's journal
again and compares. Neither needs ROS.
"""
