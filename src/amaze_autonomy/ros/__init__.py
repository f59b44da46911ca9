"""What rospy lacks: calls with a limit, counting subscribers, clocks, and the tables of interface/ as ROS classes."""
