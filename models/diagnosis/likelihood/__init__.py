"""Evidence for an effect: how likely it makes the judged runs, beside all that is not known anyway."""
