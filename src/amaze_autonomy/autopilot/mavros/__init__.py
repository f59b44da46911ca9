"""mavros in place of a link: its topics as MAVLink messages, its services as requests."""
