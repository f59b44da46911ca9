"""The simulated vehicle: arming, flight and battery; or one that is flown elsewhere."""
