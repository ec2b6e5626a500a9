"""What each effect would explain of a residual, alone and together with others."""
