"""What the vehicle's own nodes would have known: recorded topics fed to the monitors, one by one or as columns."""
