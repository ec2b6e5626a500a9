"""Whether a model document means a cell that can be: for those that carry no seal of the program that wrote them."""
