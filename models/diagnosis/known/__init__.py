"""The cell as the training runs know it: a bounded network, what is open of it, and how far it is off elsewhere."""
