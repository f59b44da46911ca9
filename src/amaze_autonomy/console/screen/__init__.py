"""The full screen: what stands where, in which colours, drawn when it differs; and as a picture."""
