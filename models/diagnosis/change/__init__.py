"""What is new in the cell or the rig since the model was made."""
