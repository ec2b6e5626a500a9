"""What the model's structure lacks."""
