"""From measured runs to the parameters of a network: construction, shared poles, bounded fit, penalties."""
