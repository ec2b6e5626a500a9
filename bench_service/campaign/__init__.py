"""The story of a test: what may start, which stage follows which, and in what state it is."""
