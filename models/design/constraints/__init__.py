"""What a current must keep to: limits, reachable charge, the voltage with its band."""
