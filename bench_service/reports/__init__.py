"""Reports for people: one template, one place that draws, one that finds words; a file for each kind of report."""
