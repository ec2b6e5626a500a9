"""What a current tells about the parameters of a network, and its gradient."""
