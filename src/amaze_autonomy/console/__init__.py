"""The operator's terminal: shows what the engine says, asks for a mission, and passes on what the user commands.

`model`, `wire`, `keys`, `dialog` and what `screen/` draws are pure: values in, values out. `terminal` reads the
keyboard, `screen/screen.py` and `plain` show, `ros_link` alone knows ROS, `main` puts them together.

The console is never needed to fly: it may be closed, killed or started again at any time, and several may run at once.
"""
